// OpenImageIO behind bridge/oiio.h. Every exception stops here; buffers are malloc'ed for C to free.
#include "bridge/oiio.h"

extern "C" {
#include "base/file.h"
}

#include <OpenImageIO/imageio.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace {

const double kNaN = std::numeric_limits<double>::quiet_NaN();

// The library starts threads of its own otherwise; the caller has a pool.
void one_thread()
{
    static const bool done = OIIO::attribute("threads", 1) && OIIO::attribute("exr_threads", 1);
    (void)done;
}

template <class F> cn_status guarded(const char *path, F f)
{
    try {
        one_thread();
        return f();
    } catch (const std::bad_alloc &) {
        return cn_fail(CN_ERR_NOMEM, "%s: out of memory; use a smaller photo or more memory", path);
    } catch (const std::exception &e) {
        return cn_fail(CN_ERR_FORMAT, "%s cannot be read: %s", path, e.what());
    } catch (...) {
        return cn_fail(CN_ERR_FORMAT, "%s cannot be read", path);
    }
}

void copy(char *out, size_t size, const std::string &text) { snprintf(out, size, "%s", text.c_str()); }

// A number, NaN when absent, zero or made of 0/0.
double positive(const OIIO::ImageSpec &spec, const char *name)
{
    const double x = spec.get_float_attribute(name, 0);
    return std::isfinite(x) && x > 0 ? x : kNaN;
}

// Degrees, minutes, seconds. False when absent or not finite.
bool angle(const OIIO::ImageSpec &spec, const char *name, double *degrees)
{
    const OIIO::ParamValue *p = spec.find_attribute(name);
    if (!p || p->type().basetype != OIIO::TypeDesc::FLOAT || p->type().numelements() * p->type().aggregate < 3) return false;
    const float *v = static_cast<const float *>(p->data());
    *degrees = 0;
    // Minutes or seconds written as 0/0 mean "not used".
    for (int i = 0; i < 3; i++) *degrees += std::isfinite(v[i]) ? v[i] / std::pow(60.0, i) : (i ? 0 : kNaN);
    return std::isfinite(*degrees);
}

void read_gps(const OIIO::ImageSpec &spec, cn_oiio_info *info)
{
    double lat, lon;
    if (angle(spec, "GPS:Latitude", &lat) && angle(spec, "GPS:Longitude", &lon)) {
        const std::string ns = spec.get_string_attribute("GPS:LatitudeRef"), ew = spec.get_string_attribute("GPS:LongitudeRef");
        info->latitude_deg = !ns.empty() && (ns[0] == 'S' || ns[0] == 's') ? -lat : lat;
        info->longitude_deg = !ew.empty() && (ew[0] == 'W' || ew[0] == 'w') ? -lon : lon;
        info->has_latlon = std::fabs(info->latitude_deg) <= 90 && std::fabs(info->longitude_deg) <= 180;
    }
    const OIIO::ParamValue *altitude = spec.find_attribute("GPS:Altitude");
    if (altitude && std::isfinite(altitude->get_float())) {
        info->altitude_m = altitude->get_float();
        // The reference is a byte, which some writers store as text or leave out: absent means above sea level.
        const OIIO::ParamValue *ref = spec.find_attribute("GPS:AltitudeRef");
        const bool below = ref && (ref->get_int() == 1 || ref->get_string() == "1" || ref->get_string() == std::string("\1"));
        if (below) info->altitude_m = -std::fabs(info->altitude_m);
        info->has_altitude = true;
    }
}

std::unique_ptr<OIIO::ImageInput> open(const char *path, cn_status *status)
{
    auto in = OIIO::ImageInput::open(path);
    *status = CN_OK;
    if (!in) *status = cn_fail(CN_ERR_FORMAT, "%s cannot be read: %s", path, OIIO::geterror().c_str());
    return in;
}

// Where pixel (x, y) of a w x h file goes under EXIF orientation o.
void oriented(int o, uint32_t w, uint32_t h, uint32_t x, uint32_t y, uint32_t *u, uint32_t *v)
{
    const uint32_t rx = w - 1 - x, ry = h - 1 - y;
    switch (o) {
    case 2: *u = rx, *v = y; break;
    case 3: *u = rx, *v = ry; break;
    case 4: *u = x, *v = ry; break;
    case 5: *u = y, *v = x; break;
    case 6: *u = ry, *v = x; break;
    case 7: *u = ry, *v = rx; break;
    case 8: *u = y, *v = rx; break;
    default: *u = x, *v = y;
    }
}

void spread(const std::vector<float> &raw, uint32_t channels, uint32_t w, uint32_t h, int orientation, float *rgba, uint32_t out_w)
{
    for (uint32_t y = 0; y < h; y++) {
        for (uint32_t x = 0; x < w; x++) {
            const float *p = raw.data() + (static_cast<size_t>(y) * w + x) * channels;
            uint32_t u, v;
            oriented(orientation, w, h, x, y, &u, &v);
            float *q = rgba + 4 * (static_cast<size_t>(v) * out_w + u);
            const bool grey = channels < 3;
            q[0] = p[0];
            q[1] = grey ? p[0] : p[1];
            q[2] = grey ? p[0] : p[2];
            q[3] = channels == 2 ? p[1] : channels > 3 ? p[3] : 1;
        }
    }
}

void set_attributes(OIIO::ImageSpec &spec, const cn_oiio_attribute *a)
{
    for (; a && a->name; a++) {
        if (a->text) {
            spec.attribute(a->name, a->text);
        } else {
            std::vector<float> f(a->numbers, a->numbers + a->n_numbers);
            if (a->n_numbers == 1) spec.attribute(a->name, f[0]);
            else spec.attribute(a->name, OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, a->n_numbers), f.data());
        }
    }
}

cn_status write(const char *path, const OIIO::ImageSpec &spec, OIIO::TypeDesc type, const void *pixels)
{
    char *temporary = cn_file_temporary(path);
    if (!temporary) return cn_fail(CN_ERR_NOMEM, "out of memory while writing %s", path);
    auto out = OIIO::ImageOutput::create(path);
    const bool good = out && out->open(temporary, spec) && out->write_image(type, pixels) && out->close();
    cn_status status = CN_OK;
    if (good) {
        status = cn_file_replace(temporary, path);
    } else {
        const std::string why = out ? out->geterror() : OIIO::geterror();
        status = cn_fail(CN_ERR_IO, "%s cannot be written: %s; is the disk full or read-only?", path, why.c_str());
        std::remove(temporary);
    }
    free(temporary);
    return status;
}

} // namespace

extern "C" cn_status cn_oiio_read_info(const char *path, cn_oiio_info *info)
{
    return guarded(path, [&] {
        *info = cn_oiio_info();
        cn_status status;
        auto in = open(path, &status);
        if (!in) return status;
        const OIIO::ImageSpec &spec = in->spec();
        info->width = static_cast<uint32_t>(spec.width);
        info->height = static_cast<uint32_t>(spec.height);
        info->channels = static_cast<uint32_t>(spec.nchannels);
        info->orientation = spec.get_int_attribute("Orientation", 1);
        if (info->orientation < 1 || info->orientation > 8) info->orientation = 1;
        info->is_float = spec.format.is_floating_point();
        copy(info->colour_space, sizeof info->colour_space, spec.get_string_attribute("oiio:ColorSpace"));
        read_gps(spec, info);
        info->exposure_s = positive(spec, "ExposureTime");
        info->iso = positive(spec, "Exif:PhotographicSensitivity");
        info->f_number = positive(spec, "FNumber");
        info->focal_mm = positive(spec, "Exif:FocalLength");
        info->focal_35mm = positive(spec, "Exif:FocalLengthIn35mmFilm");
        copy(info->datetime, sizeof info->datetime, spec.get_string_attribute("Exif:DateTimeOriginal"));
        copy(info->subsec, sizeof info->subsec, spec.get_string_attribute("Exif:SubsecTimeOriginal"));
        copy(info->make, sizeof info->make, spec.get_string_attribute("Make"));
        copy(info->model, sizeof info->model, spec.get_string_attribute("Model"));
        return CN_OK;
    });
}

extern "C" cn_status cn_oiio_read_rgba(const char *path, float **rgba, uint32_t *width, uint32_t *height)
{
    *rgba = nullptr;
    return guarded(path, [&] {
        cn_status status;
        auto in = open(path, &status);
        if (!in) return status;
        const OIIO::ImageSpec spec = in->spec();
        if (spec.width < 1 || spec.height < 1 || spec.width > 65535 || spec.height > 65535 || spec.nchannels < 1)
            return cn_fail(CN_ERR_FORMAT, "%s has no picture of 1 to 65535 pixels a side", path);
        const uint32_t w = static_cast<uint32_t>(spec.width), h = static_cast<uint32_t>(spec.height);
        const uint32_t channels = spec.nchannels > 4 ? 4u : static_cast<uint32_t>(spec.nchannels);
        std::vector<float> raw(static_cast<size_t>(w) * h * channels);
        // A truncated JPEG decodes "well" with a warning left behind: has_error is the only sign.
        const bool read = in->read_image(0, 0, 0, static_cast<int>(channels), OIIO::TypeDesc::FLOAT, raw.data());
        if (!read || in->has_error())
            return cn_fail(CN_ERR_FORMAT, "%s is damaged: %s", path, in->geterror().c_str());
        int orientation = spec.get_int_attribute("Orientation", 1);
        if (orientation < 1 || orientation > 8) orientation = 1;
        *width = orientation >= 5 ? h : w;
        *height = orientation >= 5 ? w : h;
        *rgba = static_cast<float *>(malloc(static_cast<size_t>(w) * h * 4 * sizeof(float)));
        if (!*rgba) return cn_fail(CN_ERR_NOMEM, "%s: out of memory; use a smaller photo or more memory", path);
        spread(raw, channels, w, h, orientation, *rgba, *width);
        return CN_OK;
    });
}

extern "C" cn_status cn_oiio_write_png(const char *path, const float *pixels, uint32_t width, uint32_t height, int channels,
                                       const cn_oiio_attribute *attributes)
{
    return guarded(path, [&] {
        OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), channels, OIIO::TypeDesc::UINT8);
        spec.attribute("oiio:ColorSpace", "sRGB");
        set_attributes(spec, attributes);
        const size_t n = static_cast<size_t>(width) * height * static_cast<size_t>(channels);
        std::vector<uint8_t> bytes(n);
        for (size_t i = 0; i < n; i++) {
            const float x = pixels[i] > 0 ? (pixels[i] < 1 ? pixels[i] : 1) : 0;
            bytes[i] = static_cast<uint8_t>(x * 255 + 0.5f);
        }
        return write(path, spec, OIIO::TypeDesc::UINT8, bytes.data());
    });
}

extern "C" cn_status cn_oiio_write_jpeg(const char *path, const float *rgb, uint32_t width, uint32_t height,
                                        const cn_oiio_attribute *attributes)
{
    return guarded(path, [&] {
        OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), 3, OIIO::TypeDesc::UINT8);
        spec.attribute("oiio:ColorSpace", "sRGB");
        spec.attribute("Compression", "jpeg:95");
        set_attributes(spec, attributes);
        return write(path, spec, OIIO::TypeDesc::FLOAT, rgb);
    });
}

extern "C" cn_status cn_oiio_write_exr(const char *path, const float *rgba, const float *depth, uint32_t width, uint32_t height,
                                       const cn_oiio_attribute *attributes)
{
    return guarded(path, [&] {
        const int channels = depth ? 5 : 4;
        OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), channels, OIIO::TypeDesc::FLOAT);
        spec.channelnames = {"R", "G", "B", "A"};
        spec.channelformats.assign(4, OIIO::TypeDesc::HALF);
        if (depth) {
            spec.channelnames.push_back("Z");
            spec.channelformats.push_back(OIIO::TypeDesc::FLOAT);
            spec.z_channel = 4;
        }
        spec.alpha_channel = 3;
        spec.attribute("compression", "zip");
        const float ap1[8] = {0.713f, 0.293f, 0.165f, 0.830f, 0.128f, 0.044f, 0.32168f, 0.33767f};
        spec.attribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), ap1);
        set_attributes(spec, attributes);
        std::vector<float> all(static_cast<size_t>(width) * height * static_cast<size_t>(channels));
        for (size_t i = 0; i < static_cast<size_t>(width) * height; i++) {
            std::memcpy(&all[i * static_cast<size_t>(channels)], rgba + 4 * i, 4 * sizeof(float));
            if (depth) all[i * 5 + 4] = depth[i];
        }
        return write(path, spec, OIIO::TypeDesc::FLOAT, all.data());
    });
}
