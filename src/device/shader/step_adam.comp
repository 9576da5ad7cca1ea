#version 460
// Adam on the float parameters. The gradients of the slots are summed in order.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer SlotGrad { float slot_grad[]; };
layout(std430, binding = 2) readonly buffer Factor { float factor[]; };
layout(std430, binding = 3) buffer Values { float value[]; };
layout(std430, binding = 4) buffer MomentM { float m[]; };
layout(std430, binding = 5) buffer MomentV { float v[]; };

void main()
{
    const uint i = gl_GlobalInvocationID.x;
    if (i >= s.n_values) return;
    float g = 0;
    for (uint k = 0; k < SLOTS; k++)
        g += slot_grad[k * s.n_values + i];
    const bool weight = i < s.n_weights;
    if (weight) g += s.decay * value[i];
    m[i] = s.beta1 * m[i] + (1 - s.beta1) * g;
    v[i] = s.beta2 * v[i] + (1 - s.beta2) * g * g;
    const float rate = weight ? s.rate_weights : s.rate_others;
    value[i] -= factor[i] * (rate * m[i] / (sqrt(v[i]) + s.epsilon));
}
