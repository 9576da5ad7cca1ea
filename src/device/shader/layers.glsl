// Layers of a network. A group of threads does as many samples as it has threads. The activations of all of them are in
// shared memory, in two halves that a layer reads and writes in turn. In a layer a thread does up to 16 rows of 4
// samples, so that a weight is read once for 4 samples, and 4 samples are read at once. All threads of a group take
// part in every layer.
#extension GL_EXT_control_flow_attributes : require
layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint LANES = 32; // a multiple of 4
layout(constant_id = 1) const uint ROWS = 64;  // width of the widest layer
shared vec4 act[2 * ROWS * (LANES / 4)];       // [half][row][4 samples]

// A row of this thread's own sample.
#define ACT(half_, row)                                                                                                \
    act[((half_) * ROWS + (row)) * (LANES / 4) + gl_LocalInvocationID.x / 4][gl_LocalInvocationID.x % 4]
#define ACT4(half_, row) vec4(ACT(half_, row), ACT(half_, (row) + 1), ACT(half_, (row) + 2), ACT(half_, (row) + 3))

// Rows of one layer, R of them at a time for each thread. The loops over R have to be unrolled: an array whose index is
// known when the shader is compiled stays in registers; another one goes to memory.
#define DENSE(NAME, R)                                                                                                 \
    void NAME(uint offset, uint n_out, uint n_in, uint from, bool relu)                                                \
    {                                                                                                                  \
        const uint quads = LANES / 4, quad = gl_LocalInvocationID.x % quads, part = gl_LocalInvocationID.x / quads;    \
        for (uint o = R * part; o < n_out; o += 4 * R) {                                                               \
            vec4 sum[R];                                                                                               \
            [[unroll]] for (uint k = 0; k < R; k++)                                                                    \
                sum[k] = vec4(0);                                                                                      \
            uint row = (offset + o) / 4;                                                                               \
            for (uint j = 0; j < n_in; j++, row += n_out / 4) {                                                        \
                const vec4 x = act[(from * ROWS + j) * quads + quad];                                                  \
                [[unroll]] for (uint k = 0; k < R / 4; k++) {                                                          \
                    const vec4 w = weights[row + k];                                                                   \
                    sum[4 * k] += w.x * x;                                                                             \
                    sum[4 * k + 1] += w.y * x;                                                                         \
                    sum[4 * k + 2] += w.z * x;                                                                         \
                    sum[4 * k + 3] += w.w * x;                                                                         \
                }                                                                                                      \
            }                                                                                                          \
            [[unroll]] for (uint k = 0; k < R; k++)                                                                    \
                if (o + k < n_out)                                                                                     \
                    act[((1 - from) * ROWS + o + k) * quads + quad] = relu ? max(sum[k], 0) : sum[k];                  \
        }                                                                                                              \
    }
DENSE(dense_wide, 16)
DENSE(dense_middle, 8)
DENSE(dense_narrow, 4)

// One layer, from half `from` of the activations to the other half. The matrix begins at float `offset`. Rows behind
// the last are computed from what follows the matrix, and are not kept. Four threads share the rows of a sample, so a
// narrow layer gives each fewer.
void dense(uint offset, uint n_out, uint n_in, uint from, bool relu)
{
    barrier();
    if (n_out >= 64)
        dense_wide(offset, n_out, n_in, from, relu);
    else if (n_out >= 32)
        dense_middle(offset, n_out, n_in, from, relu);
    else
        dense_narrow(offset, n_out, n_in, from, relu);
    barrier();
}
