#include "geo/crs.h"

#include "base/number.h"
#include "geo/geoid.h"

#include <ctype.h>
#include <math.h>
#include <proj.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { WORDS = 512 };

/* PROJ's name of the system. False: the text is none that ODM writes. */
static bool name_of(const char *text, char out[WORDS])
{
    int zone, end = 0;
    char side = 'N';
    while (isspace((unsigned char)*text))
        text++;
    if (sscanf(text, "%*1[Ww]%*1[Gg]%*1[Ss]84 %*1[Uu]%*1[Tt]%*1[Mm] %2d%n%c", &zone, &end, &side) >= 1 && end) {
        side = (char)toupper((unsigned char)side);
        snprintf(out, WORDS, "EPSG:%d", (side == 'S' ? 32700 : 32600) + zone);
        return zone >= 1 && zone <= 60;
    }
    if (strcasecmp(text, "WGS84") == 0)
        snprintf(out, WORDS, "EPSG:4326");
    else if (strstr(text, "+proj") && !strstr(text, "+type"))
        snprintf(out, WORDS, "%s +type=crs", text);
    else
        snprintf(out, WORDS, "%s", text);
    return *text != '\0';
}

/* Owns what PROJ makes. */
typedef struct coordinate_system {
    PJ_CONTEXT *context;
    PJ *crs, *operation;
} coordinate_system;

static void close_system(coordinate_system *s)
{
    proj_destroy(s->operation);
    proj_destroy(s->crs);
    if (s->context) proj_context_destroy(s->context);
    *s = (coordinate_system){ 0 };
}

/* x is east, y north. Without a vertical part on both sides PROJ passes heights through. False: PROJ knows no way. */
static bool make_operation(coordinate_system *s, const PJ *from, const char *to)
{
    static const char *const options[] = { "ALLOW_BALLPARK=NO", NULL };
    PJ *wgs84 = proj_create(s->context, to);
    PJ *raw = wgs84 ? proj_create_crs_to_crs_from_pj(s->context, from, wgs84, NULL, options) : NULL;
    s->operation = raw ? proj_normalize_for_visualization(s->context, raw) : NULL;
    proj_destroy(raw);
    proj_destroy(wgs84);
    return s->operation != NULL;
}

/* Whether PROJ has a grid for the vertical part: then heights change, and are numbers. */
static bool converts(const coordinate_system *s, const double at[3])
{
    const PJ_COORD out = proj_trans(s->operation, PJ_FWD, proj_coord(at[0], at[1], isnan(at[2]) ? 0 : at[2], HUGE_VAL));
    return isfinite(out.xyz.x) && isfinite(out.xyz.y) && isfinite(out.xyz.z);
}

/* The way from a compound system with its own heights; without its grid, the horizontal part alone. */
static bool open_compound(coordinate_system *s, const double at[3], cn_heights *heights)
{
    *heights = CN_HEIGHTS_ELLIPSOID;
    if (make_operation(s, s->crs, "EPSG:4979") && converts(s, at)) return true;
    proj_destroy(s->operation);
    s->operation = NULL;
    *heights = CN_HEIGHTS_SEA_LEVEL;
    PJ *flat = proj_crs_get_sub_crs(s->context, s->crs, 0);
    const bool good = flat && make_operation(s, flat, "EPSG:4326");
    proj_destroy(flat);
    return good;
}

static cn_status open_system(coordinate_system *s, const char *text, const double at[3], cn_heights *heights)
{
    char name[WORDS];
    *s = (coordinate_system){ .context = proj_context_create() };
    if (!s->context) return cn_fail(CN_ERR_NOMEM, "out of memory opening PROJ");
    proj_log_level(s->context, PJ_LOG_NONE);
    proj_context_set_enable_network(s->context, 0);
    if (name_of(text, name)) s->crs = proj_create(s->context, name);
    if (!s->crs || !proj_is_crs(s->crs))
        return cn_fail(CN_ERR_DATA, "\"%.80s\" is no coordinate system that PROJ knows; give one like EPSG:25832",
                       text);
    const bool good = proj_get_type(s->crs) == PJ_TYPE_COMPOUND_CRS ? open_compound(s, at, heights)
                                                                    : make_operation(s, s->crs, "EPSG:4326");
    return good ? CN_OK
                : cn_fail(CN_ERR_DATA, "PROJ knows no way from \"%.80s\" to WGS84; give coordinates in another system",
                          text);
}

static cn_status convert(const coordinate_system *s, const char *text, size_t n, double (*places)[3])
{
    for (size_t i = 0; i < n; i++) {
        double *p = places[i];
        const bool has_height = !isnan(p[2]);
        const PJ_COORD out = proj_trans(s->operation, PJ_FWD, proj_coord(p[0], p[1], has_height ? p[2] : 0, HUGE_VAL));
        if (!isfinite(out.xyz.x) || !(fabs(out.xyz.y) <= 90.0) || !isfinite(out.xyz.z))
            return cn_fail(CN_ERR_DATA, "%.10g, %.10g is no place in \"%.80s\"; x is east, y is north", p[0], p[1],
                           text);
        p[0] = out.xyz.y;
        p[1] = out.xyz.x;
        p[2] = has_height ? out.xyz.z : NAN;
    }
    return CN_OK;
}

static cn_status add_geoid(size_t n, double (*places)[3], bool *by_egm96)
{
    for (size_t i = 0; i < n; i++) {
        double undulation_m;
        CN_TRY(cn_geo_geoid_height(places[i][0], places[i][1], &undulation_m, by_egm96));
        places[i][2] += undulation_m;
    }
    return CN_OK;
}

cn_status cn_crs_to_wgs84(const char *crs, cn_heights heights, size_t n, double (*places)[3], bool *by_egm96)
{
    coordinate_system s;
    *by_egm96 = false;
    if (!n) return CN_OK;
    const locale_t before = cn_number_begin();
    cn_status status = open_system(&s, crs, places[0], &heights);
    if (status == CN_OK) status = convert(&s, crs, n, places);
    close_system(&s);
    cn_number_end(before);
    if (status == CN_OK && heights == CN_HEIGHTS_SEA_LEVEL) status = add_geoid(n, places, by_egm96);
    return status;
}
