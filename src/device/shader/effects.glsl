// What the passes of the effects share (src/effect): which take part in the step, where their parameters are, and the
// rows of what is kept of each ray. A group of rays has its rows one after the other, each with a value for every ray.
const uint DIRECTIONS = 1, APPEARANCE = 2, SKY = 4, EXPOSURE = 8, TRANSIENT = 16, POSE = 32, RUNS_DIFFER = 64,
           GAINS_LEARNED = 128;
bool is_on(uint effect)
{
    return (s.effects & effect) != 0;
}

// Floats of a photo's row.
const uint APPEARANCE_CODE = 16, SKY_CODE = 12, TRANSIENT_CODE = 16, POSE_ROW = 12;

// Length of a unit of a photo's move.
const float MOVE = 0.2;

// A small network of an effect: its weights, three layers [out][in], begin at value `at`. Rows of the inputs of its
// layers begin at x, those of the gradients of the layers' outputs at d.
struct Head {
    uint at, n_in, width, n_out, x, d;
};
const uint HEADS = 2;
Head head_of(uint which)
{
    return which == 0 ? Head(s.at_sky_head, 16, 32, 4, 0, 0) : Head(s.at_transient_head, 36, 64, 8, 80, 68);
}
uint head_weights(Head h)
{
    return h.width * (h.n_in + h.width + h.n_out);
}
// Layer l of a network, whose weights begin at `offset` behind the network's first: `rows` outputs from `columns`
// inputs.
void layer_of(Head h, uint l, out uint offset, out uint rows, out uint columns)
{
    offset = l == 0 ? 0 : l == 1 ? h.width * h.n_in : h.width * (h.n_in + h.width);
    rows = l < 2 ? h.width : h.n_out;
    columns = l == 0 ? h.n_in : h.width;
}
// The network and the layer of a weight, counted over all networks. False past the last, or where the network's effect
// takes no part.
bool find_weight(inout uint k, out Head h, out uint l, out uint offset, out uint rows, out uint columns)
{
    for (uint which = 0; which < HEADS; which++) {
        h = head_of(which);
        for (l = 0; l < 3; l++) {
            layer_of(h, l, offset, rows, columns);
            if (k < rows * columns) return is_on(which == 0 ? SKY : TRANSIENT);
            k -= rows * columns;
        }
    }
    return false;
}

// Rows that are kept: inputs of layers (sky 16 + 2 * 32, transient 36 + 2 * 64); gradients of outputs (sky 2 * 32 + 4,
// transient 2 * 64 + 8), then those of the transients' table and of the photos' rows. As in src/device/step.h.
const uint ROWS_X = 244, ROWS_D = 241, D_FEATURE = 204, D_SKY_CODE = 212, D_GAIN = 224, D_TRANSIENT_CODE = 225;

// The transients' table: features at the nodes of a grid over each photo, in levels.
const uint LEVELS = 4, COARSEST = 8, ENTRIES = 8192, FEATURES = 2;
void nodes_of(vec2 uv, uint photo, uint which, out uint at[4], out float weight[4])
{
    const uint cells = COARSEST << which;
    const vec2 x = clamp(0.5 * (uv + 1), vec2(0), vec2(1)) * float(cells);
    const uvec2 corner = min(uvec2(x), uvec2(cells - 1));
    const vec2 part = x - vec2(corner);
    for (uint k = 0; k < 4; k++) {
        const uvec2 c = corner + uvec2(k & 1, k >> 1);
        const uint entry = (c.x ^ c.y * 2654435761u ^ photo * 805459861u) & (ENTRIES - 1);
        at[k] = head_weights(head_of(1)) + (which * ENTRIES + entry) * FEATURES;
        weight[k] = ((k & 1) != 0 ? part.x : 1 - part.x) * ((k >> 1) != 0 ? part.y : 1 - part.y);
    }
}
