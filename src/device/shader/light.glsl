// Linear light from the output of a colour network.
float light(float x)
{
    return x < 0 ? exp(x) : 1 + min(x, 1e6);
}
