// The sky's formulas (src/effect/sky.c), for training and rendering.
const float SKY_SLOPE = 0.3;

// Real spherical harmonics of a unit direction, to degree 3.
void harmonics_of(vec3 d, out float h[16])
{
    const vec3 q = d * d;
    h[0] = 0.28209479;
    h[1] = -0.48860251 * d.y;
    h[2] = 0.48860251 * d.z;
    h[3] = -0.48860251 * d.x;
    h[4] = 1.09254843 * d.x * d.y;
    h[5] = -1.09254843 * d.y * d.z;
    h[6] = 0.94617470 * q.z - 0.31539157;
    h[7] = -1.09254843 * d.x * d.z;
    h[8] = 0.54627422 * (q.x - q.y);
    h[9] = 0.59004359 * d.y * (-3 * q.x + q.y);
    h[10] = 2.89061144 * d.x * d.y * d.z;
    h[11] = 0.45704580 * d.y * (1 - 5 * q.z);
    h[12] = 0.37317633 * d.z * (5 * q.z - 3);
    h[13] = 0.45704580 * d.x * (1 - 5 * q.z);
    h[14] = 1.44530572 * d.z * (q.x - q.y);
    h[15] = 0.59004359 * d.x * (-q.x + 3 * q.y);
}
// What the sky's network gets of harmonic k: higher degrees count less.
float sky_of_degree(uint k)
{
    return k < 1 ? 1 : k < 4 ? 0.5 : k < 9 ? 0.25 : 0.125;
}
// How much sky there may be in a direction: none well below the horizon.
float sky_cover(vec3 d)
{
    const float up = clamp((d.z + 0.15) / 0.15, 0, 1);
    return up * up * (3 - 2 * up);
}
