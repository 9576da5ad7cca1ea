#include "base/date.h"

#include "base/number.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>

/* Days since 1970-01-01 in the Gregorian calendar, for years of four digits. */
static double days_since_1970(int year, int month, int day)
{
    int y = month > 2 ? year : year - 1, era_day = (153 * (month > 2 ? month - 3 : month + 9) + 2) / 5 + day - 1;
    return 365.0 * y + y / 4 - y / 100 + y / 400 + era_day - 719468;
}

double cn_parse_date_time(const char *text)
{
    int year, month, day, hour, minute, end = 0, zone_hour, zone_minute, zone_end = 0;
    double second, zone = 0;
    char sign;
    const locale_t before = cn_number_begin();
    const int n = sscanf(text, "%4d-%2d-%2dT%2d:%2d:%lf%n", &year, &month, &day, &hour, &minute, &second, &end);
    cn_number_end(before);
    if (n != 6) return NAN;
    const char *rest = text + end;
    if (sscanf(rest, "%c%2d:%2d%n", &sign, &zone_hour, &zone_minute, &zone_end) == 3 && (sign == '+' || sign == '-')) {
        zone = (sign == '-' ? -1 : 1) * (3600.0 * zone_hour + 60.0 * zone_minute);
        rest += zone_end;
    } else if (*rest == 'Z') {
        rest++;
    }
    bool valid = year >= 1 && month >= 1 && month <= 12 && day >= 1 && day <= 31 && hour >= 0 && hour <= 24 &&
                 minute >= 0 && minute < 60 && second >= 0 && second < 61;
    return *rest || !valid ? NAN
                           : days_since_1970(year, month, day) * 86400 + hour * 3600 + minute * 60 + second - zone;
}
