// Layers of a network. A group of threads does as many samples as it has threads. The activations of all of them are in
// shared memory, in two halves that a layer reads and writes in turn. In a layer a thread does 16 rows of 4 samples, so
// that a weight is read once for 4 samples. All threads of a group take part in every layer.
layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint LANES = 32; // a multiple of 4
layout(constant_id = 1) const uint ROWS = 64;  // width of the widest layer
shared float act[2 * ROWS * LANES];            // [half][row][sample]

// A row of this thread's own sample.
#define ACT(half_, row) act[((half_) * ROWS + (row)) * LANES + gl_LocalInvocationID.x]
#define ACT4(half_, row) vec4(ACT(half_, row), ACT(half_, (row) + 1), ACT(half_, (row) + 2), ACT(half_, (row) + 3))

// One layer, from half `from` of the activations to the other half. The matrix begins at float `offset`. Rows behind the
// last are computed from what follows the matrix, and are not kept.
void dense(uint offset, uint n_out, uint n_in, uint from, bool relu)
{
    const uint quads = LANES / 4, quad = gl_LocalInvocationID.x % quads, part = gl_LocalInvocationID.x / quads;
    barrier();
    for (uint o = 16 * part; o < n_out; o += 64) {
        vec4 sum[16];
        for (uint k = 0; k < 16; k++)
            sum[k] = vec4(0);
        uint row = (offset + o) / 4;
        for (uint j = 0; j < n_in; j++, row += n_out / 4) {
            const uint at = (from * ROWS + j) * LANES + 4 * quad;
            const vec4 x = vec4(act[at], act[at + 1], act[at + 2], act[at + 3]);
            for (uint k = 0; k < 4; k++) {
                const vec4 w = weights[row + k];
                sum[4 * k] += w.x * x;
                sum[4 * k + 1] += w.y * x;
                sum[4 * k + 2] += w.z * x;
                sum[4 * k + 3] += w.w * x;
            }
        }
        for (uint k = 0; k < 16; k++) {
            if (o + k >= n_out) break;
            const uint at = ((1 - from) * ROWS + o + k) * LANES + 4 * quad;
            const vec4 y = relu ? max(sum[k], 0) : sum[k];
            for (uint q = 0; q < 4; q++)
                act[at + q] = y[q];
        }
    }
    barrier();
}
