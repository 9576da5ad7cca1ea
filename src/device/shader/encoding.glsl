// The encoding of a lane, or zeros, into half 0. A pass that includes it has Enc. Eight rows are read before the first
// is kept, so that their reads overlap.
void take_encoding(uint lane, bool used, uint rows)
{
    for (uint r = 0; r < rows; r += 8) {
        float x[8];
        [[unroll]] for (uint k = 0; k < 8; k++)
            x[k] = used && r + k < rows ? enc[at_lane(lane, r + k, rows)] : 0;
        [[unroll]] for (uint k = 0; k < 8; k++)
            if (r + k < rows) ACT(0, r + k) = x[k];
    }
}
