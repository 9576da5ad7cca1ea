// A level of the hash grid: (resolution, entries, offset in the table, hashed).
uint entry_of(uvec4 l, uvec3 v)
{
    if (l.w == 0) return v.x + (l.x + 2) * (v.y + (l.x + 2) * v.z);
    const uint x = (v.x >> 2) << 4 | (v.x & 1) | (v.x & 2) << 2;
    const uint y = ((v.y >> 1) * 2654435761u) << 4 | (v.y & 1) << 1;
    const uint z = ((v.z >> 1) * 805459861u) << 4 | (v.z & 1) << 2;
    return (x ^ y ^ z) & (l.y - 1);
}
// The lowest corner of the cell around a place in [0, 1], and the place in the cell.
void cell_at(uvec4 l, vec3 u, out uvec3 corner, out vec3 f)
{
    precise const vec3 x = clamp(u, vec3(0), vec3(1)) * float(l.x) + 0.5;
    const vec3 low = floor(x);
    f = x - low;
    corner = uvec3(low);
}
vec3 corner_weights(uint c, vec3 f)
{
    return mix(1 - f, f, equal(uvec3(c & 1, c >> 1 & 1, c >> 2), uvec3(1)));
}
