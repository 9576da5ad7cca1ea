// The cells that the rays of a step have seen, for multi-view support (src/train/support.c). A thread does one ray of a
// group. On the processor the rays of a step change a cell one after the other. Here three passes find what they come to:
// the last ray that saw a cell, and the last ray of another photo than that one's; how many rays came after the latter;
// and the new state of the cell. None of this depends on the order of the threads.
layout(local_size_x = 32) in;
layout(std430, binding = 1) readonly buffer RaySamples { uint ray_samples[]; };
layout(std430, binding = 2) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 3) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 4) readonly buffer VisitSeen { float visit_seen[]; };
layout(std430, binding = 5) readonly buffer Cell { uint support_cell[]; };

const float SEEN = 0.1; // part of the light that reaches a cell which counts as seen
const uint HALF = 65535; // a cell's last two rays are the halves of a word: the ray's number plus 1; 0: none

// The samples of this thread's ray: lane to end.
void samples_of(out uint r, out uint lane, out uint end)
{
    const uint g = gl_WorkGroupID.x;
    r = g * GROUP + gl_LocalInvocationID.x;
    lane = end = 0;
    if (group_panel[g].x == NONE || group_samples[g] == 0) return;
    lane = group_panel[g].x * PANEL;
    for (uint k = g * GROUP; k < r; k++)
        lane += ray_samples[k];
    end = lane + ray_samples[r];
}

// Whether the ray saw the sample's cell, which then is `cell`. It counts once for samples that follow each other in a
// cell.
bool sees(uint lane, inout uint cell)
{
    const uint c = support_cell[lane];
    if (!(visit_seen[lane] >= SEEN) || c == cell) return false;
    cell = c;
    return true;
}
