// The random numbers of src/base/rng.h, bit for bit. A number of 64 bits is a pair of words, the lower first.
uvec2 add64(uvec2 a, uvec2 b)
{
    uint carry;
    const uint low = uaddCarry(a.x, b.x, carry);
    return uvec2(low, a.y + b.y + carry);
}
uvec2 mul64(uvec2 a, uvec2 b)
{
    uint high, low;
    umulExtended(a.x, b.x, high, low);
    return uvec2(low, high + a.x * b.y + a.y * b.x);
}
// x ^ x >> by; 0 < by < 32
uvec2 fold64(uvec2 x, int by)
{
    return x ^ uvec2(x.x >> by | x.y << (32 - by), x.y >> by);
}
uvec2 rng_mix(uvec2 x)
{
    x = mul64(fold64(x, 30), uvec2(0x1ce4e5b9u, 0xbf58476du));
    x = mul64(fold64(x, 27), uvec2(0x133111ebu, 0x94d049bbu));
    return fold64(x, 31);
}
const uvec2 GOLDEN = uvec2(0x7f4a7c15u, 0x9e3779b9u);
// The higher word.
uint rng_high(uvec2 seed, uint stream, uvec2 counter)
{
    const uvec2 key = rng_mix(add64(seed, mul64(GOLDEN, uvec2(stream + 1, 0))));
    return rng_mix(add64(key, mul64(GOLDEN, add64(counter, uvec2(1, 0))))).y;
}
uint rng_below(uvec2 seed, uint stream, uvec2 counter, uint n)
{
    uint high, low;
    umulExtended(rng_high(seed, stream, counter), n, high, low);
    return high;
}
