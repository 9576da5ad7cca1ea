/* Angles in radians and in degrees. */
#ifndef CONURB_BASE_UNITS_H
#define CONURB_BASE_UNITS_H

#define CN_PI 3.14159265358979323846

static inline double cn_radians(double angle_deg)
{
    return angle_deg * (CN_PI / 180);
}

static inline double cn_degrees(double angle_rad)
{
    return angle_rad / (CN_PI / 180);
}
#endif
