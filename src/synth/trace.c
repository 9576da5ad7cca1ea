#include "synth/trace.h"

#include <embree3/rtcore.h>
#include <stdlib.h>

#define NEAR 1e-4f

struct cn_device {
    RTCDevice device;
};
struct cn_tracer {
    RTCScene scene;
    const cn_mesh *mesh;
};

cn_status cn_device_create(cn_device **device)
{
    *device = calloc(1, sizeof **device);
    if (!*device) return cn_fail(CN_ERR_NOMEM, "out of memory while starting Embree");
    /* One thread, so that the same tree comes out each time; one instruction set, so that machines agree. */
    (*device)->device = rtcNewDevice("threads=1,isa=avx2");
    if ((*device)->device) return CN_OK;
    const int error = (int)rtcGetDeviceError(NULL);
    cn_device_destroy(device);
    return cn_fail(CN_ERR_TOOL, "Embree does not start on this machine (error %d); it wants a processor with AVX2",
                   error);
}

void cn_device_destroy(cn_device **device)
{
    if (!*device) return;
    if ((*device)->device) rtcReleaseDevice((*device)->device);
    free(*device);
    *device = NULL;
}

/* Corners in Embree's order: a = 1 at the second, b = 1 at the fourth; of a triangle the third is the fourth again. */
static void corners(const cn_patch *p, float *v)
{
    for (int a = 0; a < 3; a++) {
        v[a] = p->corner[a];
        v[3 + a] = p->corner[a] + p->u[a];
        v[9 + a] = p->corner[a] + p->v[a];
        v[6 + a] = p->triangle ? v[9 + a] : v[3 + a] + p->v[a];
    }
}

static cn_status fill(RTCDevice device, RTCScene scene, const cn_mesh *mesh)
{
    if (mesh->n_patches == 0) return CN_OK;
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_QUAD);
    float *v = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                                       (size_t)mesh->n_patches * 4);
    unsigned *index = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT4,
                                              4 * sizeof(unsigned), mesh->n_patches);
    if (!v || !index) {
        rtcReleaseGeometry(geometry);
        return cn_fail(CN_ERR_NOMEM, "out of memory for the rays; give a smaller --size");
    }
    for (unsigned i = 0; i < mesh->n_patches; i++) {
        corners(&mesh->patches[i], v + (size_t)12 * i);
        for (unsigned k = 0; k < 4; k++)
            index[4 * (size_t)i + k] = 4 * i + k;
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    return CN_OK;
}

cn_status cn_tracer_create(cn_tracer **tracer, cn_device *device, const cn_mesh *mesh)
{
    *tracer = calloc(1, sizeof **tracer);
    if (!*tracer) return cn_fail(CN_ERR_NOMEM, "out of memory for the rays; give a smaller --size");
    (*tracer)->mesh = mesh;
    (*tracer)->scene = rtcNewScene(device->device);
    rtcSetSceneFlags((*tracer)->scene, RTC_SCENE_FLAG_ROBUST);
    const cn_status status = fill(device->device, (*tracer)->scene, mesh);
    if (status != CN_OK) {
        cn_tracer_destroy(tracer);
        return status;
    }
    rtcCommitScene((*tracer)->scene);
    return CN_OK;
}

void cn_tracer_destroy(cn_tracer **tracer)
{
    if (!*tracer) return;
    rtcReleaseScene((*tracer)->scene);
    free(*tracer);
    *tracer = NULL;
}

static struct RTCRay ray_of(const double o[3], const double d[3], double far)
{
    return (struct RTCRay){ .org_x = (float)o[0],
                            .org_y = (float)o[1],
                            .org_z = (float)o[2],
                            .tnear = NEAR,
                            .dir_x = (float)d[0],
                            .dir_y = (float)d[1],
                            .dir_z = (float)d[2],
                            .tfar = (float)far,
                            .mask = ~0u };
}

static double triple(const double a[3], const double b[3], const double c[3])
{
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

/* Embree says which patch; where exactly is solved for here: corner + a u + b v = origin + t direction. */
static bool solve(const cn_patch *p, const double o[3], const double d[3], cn_hit *hit)
{
    double u[3], v[3], w[3], back[3];
    for (int a = 0; a < 3; a++) {
        u[a] = p->u[a];
        v[a] = p->v[a];
        w[a] = o[a] - p->corner[a];
        back[a] = -d[a];
    }
    const double det = triple(u, v, back);
    if (det == 0) return false;
    const double a = triple(w, v, back) / det, b = triple(u, w, back) / det;
    hit->a = (float)(a < 0 ? 0 : a > 1 ? 1 : a);
    hit->b = (float)(b < 0 ? 0 : b > 1 ? 1 : b);
    hit->t = triple(u, v, w) / det;
    return hit->t > 0;
}

bool cn_tracer_hit(const cn_tracer *tracer, const double o[3], const double d[3], double far, cn_hit *hit)
{
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    struct RTCRayHit query = { .ray = ray_of(o, d, far), .hit = { .geomID = RTC_INVALID_GEOMETRY_ID } };
    rtcIntersect1(tracer->scene, &context, &query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return false;
    hit->patch = query.hit.primID;
    return solve(&tracer->mesh->patches[hit->patch], o, d, hit);
}

bool cn_tracer_blocked(const cn_tracer *tracer, const double o[3], const double d[3], double far)
{
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    struct RTCRay ray = ray_of(o, d, far);
    rtcOccluded1(tracer->scene, &context, &ray);
    return ray.tfar < 0;
}
