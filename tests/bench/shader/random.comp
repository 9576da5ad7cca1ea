// Independent reads, or atomic additions, of words at random places.
#version 450
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint EACH = 1;
layout(constant_id = 1) const uint UPDATES = 0;
layout(set = 0, binding = 0) buffer Table { uint table[]; };
layout(set = 0, binding = 1) writeonly buffer To { uint to[]; };

void main()
{
    const uint words = table.length();
    uint x = gl_GlobalInvocationID.x * 2654435761u + 1, sum = 0;
    for (uint k = 0; k < EACH; k++) {
        x ^= x << 13;
        x ^= x >> 17;
        x ^= x << 5;
        if (UPDATES == 1)
            atomicAdd(table[x % words], 1);
        else
            sum += table[x % words];
    }
    to[gl_GlobalInvocationID.x] = sum;
}
