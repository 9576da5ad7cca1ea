/* A survey of a made city without pixels: true poses, points and where photos see them with noise, and the models that
 * a mapper might make of groups of its photos, each in a frame of its own, bent and noisy. */
#ifndef CONURB_BENCH_POSE_CITY_H
#define CONURB_BENCH_POSE_CITY_H
#include "conurb/pose.h"
#include "pose/groups.h"

typedef struct pose_city {
    cn_scene truth; /* in the frame below */
    cn_photo_index index;
    cn_frame frame;
} pose_city;
typedef struct pose_city_options {
    uint32_t n_photos;
    double gps_sigma_m; /* of a coordinate; heights half as much again */
    bool has_gps;
    uint32_t points; /* a photo; a point is seen by about seven photos */
} pose_city_options;

/* The same for the same options. Stops the program when memory runs out. */
void pose_city_make(pose_city *city, const pose_city_options *options);
void pose_city_free(pose_city *city);
/* The groups that `conurb poses` would make. */
void pose_city_split(const pose_city *city, uint32_t most, cn_photo_groups *groups);
/* The model of group g: some photos get no pose, shapes are bent by decimetres, lenses are off by 0.2 %. */
void pose_city_model(const pose_city *city, const cn_photo_groups *groups, uint32_t g, cn_scene *out);

typedef struct pose_city_error {
    double rms_m, most_m; /* distance of camera centres from the truth, where the scene says that they are on Earth */
    double fit_rms_m;     /* after the best similarity */
    uint32_t n;
} pose_city_error;
pose_city_error pose_city_compare(const pose_city *city, const cn_scene *scene, const cn_frame *frame);
#endif
