#include "effect/sky_turn.h"

#include "effect/sky_grid.h"

void cn_sky_turn_to_picture(cn_side up, const int cell[2], const int n[2], const double size[2], double px[2])
{
    const int back[2] = { n[0] - 1 - cell[0], n[1] - 1 - cell[1] };
    const bool on_side = up == CN_SIDE_LEFT || up == CN_SIDE_RIGHT;
    const int stored[4][2] = { [CN_SIDE_TOP] = { cell[0], cell[1] },
                               [CN_SIDE_LEFT] = { cell[1], back[0] },
                               [CN_SIDE_RIGHT] = { back[1], cell[0] },
                               [CN_SIDE_BOTTOM] = { back[0], back[1] } };
    for (int a = 0; a < 2; a++)
        px[a] = (stored[up][a] + 0.5) * size[a] / n[on_side ? 1 - a : a];
}

int cn_sky_turn_to_upright(cn_side up, int at)
{
    enum { X = CN_SKY_HINT_X, Y = CN_SKY_HINT_Y };
    const int x = at % X, y = at / X;
    switch (up) {
    case CN_SIDE_LEFT: return x * Y / X * X + X - 1 - y * X / Y;
    case CN_SIDE_RIGHT: return (Y - 1 - x * Y / X) * X + y * X / Y;
    case CN_SIDE_BOTTOM: return CN_SKY_HINTS - 1 - at;
    case CN_SIDE_TOP: break;
    }
    return at;
}
