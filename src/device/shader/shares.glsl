// The parts' shares of a place on the map, as in src/render/partition.c.
// The distance of a place on the map to a part's centre, with the part's offset.
float distance_to(uint part, vec2 on_map)
{
    return length(on_map - parts[part].centre) + parts[part].offset;
}
float square_share(uint part, float d, float least)
{
    const float g = max(1 - (d - least) / parts[part].blend_width, 0);
    return g * g;
}
// The smallest distance of all parts, and the sum of their shares.
void weigh(vec2 on_map, out float least, out float sum)
{
    least = uintBitsToFloat(0x7f800000u);
    sum = 0;
    for (uint p = 0; p < push.parts; p++)
        least = min(least, distance_to(p, on_map));
    for (uint p = 0; p < push.parts; p++)
        sum += square_share(p, distance_to(p, on_map), least);
}
