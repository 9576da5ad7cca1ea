// Layers of a network. A thread does one sample. Its activations are in a column of shared memory that no other thread
// reads, so no barrier is needed.
#extension GL_EXT_control_flow_attributes : require
layout(local_size_x_id = 0) in;
layout(constant_id = 0) const uint LANES = 32;
layout(constant_id = 1) const uint ROWS = 64; // width of the widest layer
shared float act[2 * ROWS * LANES];

uint at(uint half_, uint row)
{
    return (half_ * ROWS + row) * LANES + gl_LocalInvocationID.x;
}

// One layer, from half `from` of the activations to the other half. The matrix begins at float `offset`. Its rows are
// read 16 at a time. The loops over these have to be unrolled: else the sums go to memory instead of registers.
void dense(uint offset, uint n_out, uint n_in, uint from, bool relu)
{
    for (uint o = 0; o < n_out; o += 16) {
        vec4 sum[4] = { vec4(0), vec4(0), vec4(0), vec4(0) };
        uint row = (offset + o) / 4;
        for (uint j = 0; j < n_in; j++, row += n_out / 4) {
            const float x = act[at(from, j)];
            [[unroll]] for (uint k = 0; k < 4; k++)
                sum[k] += x * weights[row + k];
        }
        [[unroll]] for (uint k = 0; k < 4; k++) {
            const vec4 y = relu ? max(sum[k], 0) : sum[k];
            [[unroll]] for (uint c = 0; c < 4; c++)
                if (o + 4 * k + c < n_out) act[at(1 - from, o + 4 * k + c)] = y[c];
        }
    }
}
