// OpenImageIO behind bridge/oiio.h. Every exception is caught here. Buffers come from malloc, so that C can free them.
#include "bridge/oiio.h"

extern "C" {
#include "base/file.h"
}
#include "base/srgb.h"
#include "bridge/jpeg.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <limits>
#include <memory>
#include <mutex>
#include <new>
#include <string>
#include <vector>

namespace
{

const float kHalfMost = 65504; // a larger half is infinite
const double kNaN = std::numeric_limits<double>::quiet_NaN();

// Red, green, blue and white of ACEScg and ACES2065-1.
const float kAP1[8] = { 0.713f, 0.293f, 0.165f, 0.830f, 0.128f, 0.044f, 0.32168f, 0.33767f };
const float kAP0[8] = { 0.7347f, 0.2653f, 0.0f, 1.0f, 0.0001f, -0.077f, 0.32168f, 0.33767f };

template <class F> cn_status guarded(const char *path, cn_status kind, const char *verb, F f)
{
    try {
        return f();
    } catch (const std::bad_alloc &) {
        return cn_fail(CN_ERR_NOMEM, "%s: out of memory; use a smaller picture or more memory", path);
    } catch (const std::exception &e) {
        return cn_fail(kind, "%s cannot be %s: %s", path, verb, e.what());
    } catch (...) {
        return cn_fail(kind, "%s cannot be %s", path, verb);
    }
}
template <class F> cn_status reading(const char *path, F f)
{
    return guarded(path, CN_ERR_FORMAT, "read", f);
}
template <class F> cn_status writing(const char *path, F f)
{
    return guarded(path, CN_ERR_IO, "written", f);
}

void copy(char *out, size_t size, const std::string &text)
{
    snprintf(out, size, "%s", text.c_str());
}

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
    if (!p || p->type().basetype != OIIO::TypeDesc::FLOAT || p->type().basevalues() < 3) return false;
    const float *v = static_cast<const float *>(p->data());
    *degrees = 0;
    // Minutes or seconds written as 0/0 mean "not used".
    for (int i = 0; i < 3; i++)
        *degrees += std::isfinite(v[i]) ? v[i] / std::pow(60.0, i) : (i ? 0 : kNaN);
    return std::isfinite(*degrees);
}

bool starts_with(const OIIO::ImageSpec &spec, const char *name, char upper)
{
    const std::string text = spec.get_string_attribute(name);
    return !text.empty() && std::toupper(static_cast<unsigned char>(text[0])) == upper;
}

void read_gps(const OIIO::ImageSpec &spec, cn_exif *exif)
{
    double lat = kNaN, lon = kNaN;
    const bool placed = angle(spec, "GPS:Latitude", &lat) && angle(spec, "GPS:Longitude", &lon);
    exif->has_latlon = placed && cn_exif_is_place(lat, lon);
    const bool tagged = spec.find_attribute("GPS:Latitude") || spec.find_attribute("GPS:Longitude");
    exif->has_bad_gps = tagged && !exif->has_latlon;
    if (exif->has_latlon) {
        exif->latitude_deg = starts_with(spec, "GPS:LatitudeRef", 'S') ? -lat : lat;
        exif->longitude_deg = starts_with(spec, "GPS:LongitudeRef", 'W') ? -lon : lon;
    }
    const OIIO::ParamValue *altitude = spec.find_attribute("GPS:Altitude");
    if (altitude && std::isfinite(altitude->get_float())) {
        exif->altitude_m = altitude->get_float();
        // The reference is a byte. Some writers store it as text. When it is absent, the height is above sea level.
        const OIIO::ParamValue *ref = spec.find_attribute("GPS:AltitudeRef");
        const bool below = ref && (ref->get_int() == 1 || ref->get_string() == "1" || ref->get_string() == "\1");
        if (below) exif->altitude_m = -std::fabs(exif->altitude_m);
        exif->has_altitude = true;
    }
}

void read_exif(const OIIO::ImageSpec &spec, cn_exif *exif)
{
    read_gps(spec, exif);
    exif->exposure_s = positive(spec, "ExposureTime");
    exif->iso = positive(spec, "Exif:PhotographicSensitivity");
    exif->f_number = positive(spec, "FNumber");
    exif->focal_mm = positive(spec, "Exif:FocalLength");
    exif->focal_35mm = positive(spec, "Exif:FocalLengthIn35mmFilm");
    copy(exif->datetime, sizeof exif->datetime, spec.get_string_attribute("Exif:DateTimeOriginal"));
    copy(exif->subsec, sizeof exif->subsec, spec.get_string_attribute("Exif:SubsecTimeOriginal"));
    copy(exif->make, sizeof exif->make, spec.get_string_attribute("Make"));
    copy(exif->model, sizeof exif->model, spec.get_string_attribute("Model"));
}

bool has_primaries(const OIIO::ImageSpec &spec, const float *primaries)
{
    const OIIO::ParamValue *p = spec.find_attribute("chromaticities");
    if (!p || p->type().basetype != OIIO::TypeDesc::FLOAT || p->type().basevalues() != 8) return false;
    const float *v = static_cast<const float *>(p->data());
    for (int i = 0; i < 8; i++)
        if (!(std::fabs(v[i] - primaries[i]) < 1e-3f)) return false;
    return true;
}

// An EXR does not name its colour space. Its chromaticities tell which one it is.
std::string colour_space(const OIIO::ImageSpec &spec)
{
    if (has_primaries(spec, kAP1)) return "ACEScg";
    if (has_primaries(spec, kAP0)) return "ACES2065-1";
    return spec.get_string_attribute("oiio:ColorSpace");
}

int orientation_of(const OIIO::ImageSpec &spec)
{
    const int orientation = spec.get_int_attribute("Orientation", 1);
    return orientation >= 1 && orientation <= 8 ? orientation : 1;
}

// OpenImageIO 2.4.7 fills static tables of ICC and EXIF tags in its first open, without a lock (its issues 3756 and
// 3767). Version 2.4.8 fixes this. Opening reads the head only, so opening one file at a time costs little. Decoding is
// not locked.
std::mutex &open_lock()
{
    static std::mutex lock;
    return lock;
}

std::unique_ptr<OIIO::ImageInput> open(const char *path, cn_status *status)
{
    *status = CN_OK;
    // Colours under a transparent pixel stay as they are in the file.
    OIIO::ImageSpec hints;
    hints.attribute("oiio:UnassociatedAlpha", 1);
    std::unique_ptr<OIIO::ImageInput> in;
    {
        const std::lock_guard<std::mutex> one_at_a_time(open_lock());
        in = OIIO::ImageInput::open(path, &hints);
    }
    if (!in) {
        const std::string why = OIIO::geterror();
        *status = cn_fail(cn_file_exists(path) ? CN_ERR_FORMAT : CN_ERR_IO, "%s cannot be read: %s", path, why.c_str());
    } else {
        in->threads(1); // the caller has a pool
    }
    return in;
}

// What decoding needs to know about a file.
struct layout {
    uint32_t width, height, channels, first; // first: channel to begin with
    int alpha, orientation;
    uint32_t out_width() const { return orientation >= 5 ? height : width; }
    uint32_t out_height() const { return orientation >= 5 ? width : height; }
};

cn_status layout_of(const char *path, const OIIO::ImageSpec &spec, layout *l)
{
    const int most = 65535;
    const bool wide = spec.width >= 1 && spec.width <= most, high = spec.height >= 1 && spec.height <= most;
    if (!wide || !high || spec.depth > 1 || spec.nchannels < 1)
        return cn_fail(CN_ERR_FORMAT, "%s has no picture of 1 to %d pixels a side", path, most);
    l->width = static_cast<uint32_t>(spec.width);
    l->height = static_cast<uint32_t>(spec.height);
    l->channels = spec.nchannels > 4 ? 4u : static_cast<uint32_t>(spec.nchannels);
    l->first = 0;
    l->alpha = spec.alpha_channel < static_cast<int>(l->channels) ? spec.alpha_channel : -1;
    l->orientation = orientation_of(spec);
    return CN_OK;
}

// Decodes band by band, so that a small file that claims a huge picture fails before it takes much memory.
// use(first row, rows, samples) gets each band.
template <class F> cn_status decode(const char *path, OIIO::ImageInput &in, const layout &l, F use)
{
    const OIIO::ImageSpec spec = in.spec();
    const int step = spec.tile_width ? std::max(spec.tile_height, 1) : 64;
    const int from = static_cast<int>(l.first), to = from + static_cast<int>(l.channels);
    std::vector<float> band(static_cast<size_t>(std::min(step, spec.height)) * l.width * l.channels);
    for (int row = 0; row < spec.height; row += step) {
        const int rows = std::min(step, spec.height - row), y = spec.y + row;
        const bool read = spec.tile_width
                              ? in.read_tiles(0, 0, spec.x, spec.x + spec.width, y, y + rows, 0, 1, from, to,
                                              OIIO::TypeDesc::FLOAT, band.data())
                              : in.read_scanlines(0, 0, y, y + rows, 0, from, to, OIIO::TypeDesc::FLOAT, band.data());
        // The library decodes a truncated JPEG without failing. Only has_error tells that it is truncated.
        if (!read || in.has_error()) {
            const std::string why = in.has_error() ? in.geterror() : "it ends too early";
            if (!read || !cn_jpeg_is_whole(path, why.c_str()))
                return cn_fail(CN_ERR_FORMAT, "%s is damaged: %s", path, why.c_str());
        }
        use(static_cast<uint32_t>(row), static_cast<uint32_t>(rows), band.data());
    }
    return CN_OK;
}

// The index of the file's pixel (x, y) in the picture, once its EXIF orientation is applied.
size_t oriented(const layout &l, uint32_t x, uint32_t y)
{
    const uint32_t rx = l.width - 1 - x, ry = l.height - 1 - y;
    uint32_t u = x, v = y;
    switch (l.orientation) {
    case 2: u = rx, v = y; break;
    case 3: u = rx, v = ry; break;
    case 4: u = x, v = ry; break;
    case 5: u = y, v = x; break;
    case 6: u = ry, v = x; break;
    case 7: u = ry, v = rx; break;
    case 8: u = y, v = rx; break;
    default: break;
    }
    return static_cast<size_t>(v) * l.out_width() + u;
}

void spread(const layout &l, uint32_t row, uint32_t rows, const float *band, float *rgba)
{
    const bool grey = l.channels < 3;
    for (uint32_t y = row; y < row + rows; y++) {
        for (uint32_t x = 0; x < l.width; x++, band += l.channels) {
            float *q = rgba + 4 * oriented(l, x, y);
            q[0] = band[0];
            q[1] = grey ? band[0] : band[1];
            q[2] = grey ? band[0] : band[2];
            q[3] = l.alpha >= 0 ? band[l.alpha] : 1;
        }
    }
}

// The channel that holds distances.
uint32_t depth_channel(const OIIO::ImageSpec &spec)
{
    for (int i = 0; i < spec.nchannels; i++) {
        std::string name = spec.channel_name(i);
        for (char &c : name)
            c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
        if (name == "z" || name == "depth") return static_cast<uint32_t>(i);
    }
    return 0;
}

// EXIF tags that are whole numbers; the library drops them when given as floats.
bool is_whole(const std::string &name)
{
    return name == "Orientation" || name == "GPS:AltitudeRef" || name == "Exif:PhotographicSensitivity" ||
           name == "Exif:FocalLengthIn35mmFilm";
}

// The library writes numbers such as 1/64, whose inverse is a whole number, as 1/0. The next larger float is written
// correctly, and has the same digits.
float writable(double number)
{
    const float x = static_cast<float>(number);
    return x > 0 && x < 1 && std::floor(1.0 / x) == 1.0 / x ? std::nextafter(x, 1.0f) : x;
}

void set_attributes(OIIO::ImageSpec &spec, const cn_oiio_attribute *a)
{
    for (; a && a->name; a++) {
        if (a->text) {
            spec.attribute(a->name, a->text);
        } else if (a->n_numbers == 1 && is_whole(a->name)) {
            spec.attribute(a->name, static_cast<int>(a->numbers[0]));
        } else if (a->n_numbers == 1) {
            spec.attribute(a->name, writable(a->numbers[0]));
        } else if (a->n_numbers > 1) {
            std::vector<float> f(a->numbers, a->numbers + a->n_numbers);
            spec.attribute(a->name, OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, a->n_numbers), f.data());
        }
    }
}

cn_status write(const char *path, const OIIO::ImageSpec &spec, OIIO::TypeDesc type, const void *pixels)
{
    char *temporary = cn_file_temporary(path);
    if (!temporary) return cn_fail(CN_ERR_NOMEM, "out of memory while writing %s", path);
    auto out = OIIO::ImageOutput::create(path);
    if (out) out->threads(1); // the caller has a pool
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

// From [0,1], clamped.
std::vector<uint8_t> to_bytes(const float *values, size_t n)
{
    std::vector<uint8_t> bytes(n);
    for (size_t i = 0; i < n; i++) {
        const float x = values[i] > 0 ? (values[i] < 1 ? values[i] : 1) : 0;
        bytes[i] = static_cast<uint8_t>(x * 255 + 0.5f);
    }
    return bytes;
}

// From linear light of any scale to sRGB in [0,1]. White is the 99th percentile of green.
void encode_linear(std::vector<float> &rgb)
{
    std::vector<float> sample;
    for (size_t i = 1; i < rgb.size(); i += 3 * 31)
        if (std::isfinite(rgb[i])) sample.push_back(rgb[i]);
    float white = 0;
    if (!sample.empty()) {
        const auto at = sample.begin() + static_cast<std::ptrdiff_t>(sample.size() * 99 / 100);
        std::nth_element(sample.begin(), at, sample.end());
        white = *at;
    }
    const float scale = white > 0 ? 1 / white : 1;
    for (float &x : rgb) {
        const float y = x * scale;
        x = y > 0 ? static_cast<float>(cn_srgb_encode(std::fmin(y, 1.0f))) : 0;
    }
}

} // namespace

extern "C" void cn_oiio_own_process(void)
{
    OIIO::attribute("threads", 1);
    OIIO::attribute("exr_threads", 1);
}

extern "C" cn_status cn_oiio_read_info(const char *path, cn_oiio_info *info)
{
    return reading(path, [&] {
        *info = cn_oiio_info();
        cn_status status;
        auto in = open(path, &status);
        if (!in) return status;
        const OIIO::ImageSpec &spec = in->spec();
        info->width = static_cast<uint32_t>(spec.width);
        info->height = static_cast<uint32_t>(spec.height);
        info->channels = static_cast<uint32_t>(spec.nchannels);
        info->orientation = orientation_of(spec);
        info->is_float = spec.format.is_floating_point();
        info->is_deep = spec.format.size() > 1;
        copy(info->colour_space, sizeof info->colour_space, colour_space(spec));
        read_exif(spec, &info->exif);
        return CN_OK;
    });
}

extern "C" cn_status cn_oiio_read_icc(const char *path, void **profile, size_t *size)
{
    *profile = nullptr;
    *size = 0;
    return reading(path, [&] {
        cn_status status;
        auto in = open(path, &status);
        if (!in) return status;
        const OIIO::ParamValue *p = in->spec().find_attribute("ICCProfile");
        if (!p || p->type().basetype != OIIO::TypeDesc::UINT8 || p->type().size() == 0) return CN_OK;
        *profile = malloc(p->type().size());
        if (!*profile) throw std::bad_alloc();
        *size = p->type().size();
        std::memcpy(*profile, p->data(), *size);
        return CN_OK;
    });
}

extern "C" cn_status cn_oiio_check(const char *path, uint32_t *width, uint32_t *height)
{
    return reading(path, [&] {
        cn_status status;
        auto in = open(path, &status);
        if (!in) return status;
        layout l;
        CN_TRY(layout_of(path, in->spec(), &l));
        *width = l.out_width();
        *height = l.out_height();
        return decode(path, *in, l, [](uint32_t, uint32_t, const float *) {});
    });
}

extern "C" cn_status cn_oiio_read_rgba(const char *path, float **rgba, uint32_t *width, uint32_t *height)
{
    *rgba = nullptr;
    return reading(path, [&] {
        cn_status status;
        auto in = open(path, &status);
        if (!in) return status;
        layout l;
        CN_TRY(layout_of(path, in->spec(), &l));
        std::unique_ptr<float, void (*)(void *)> pixels(
            static_cast<float *>(malloc(static_cast<size_t>(l.width) * l.height * 4 * sizeof(float))), free);
        if (!pixels) throw std::bad_alloc();
        CN_TRY(decode(path, *in, l, [&](uint32_t row, uint32_t rows, const float *band) {
            spread(l, row, rows, band, pixels.get());
        }));
        *width = l.out_width();
        *height = l.out_height();
        *rgba = pixels.release();
        return CN_OK;
    });
}

extern "C" cn_status cn_oiio_read_map(const char *path, uint32_t channels, cn_oiio_map *map)
{
    *map = cn_oiio_map();
    return reading(path, [&] {
        cn_status status;
        auto in = open(path, &status);
        if (!in) return status;
        const OIIO::ImageSpec &spec = in->spec();
        layout l;
        CN_TRY(layout_of(path, spec, &l));
        if (spec.nchannels < static_cast<int>(channels))
            return cn_fail(CN_ERR_FORMAT, "%s has fewer than %u channels", path, channels);
        l.channels = channels;
        l.first = channels == 1 ? depth_channel(spec) : 0;
        const size_t n = static_cast<size_t>(l.width) * l.height * channels;
        std::unique_ptr<float, void (*)(void *)> values(static_cast<float *>(malloc(n * sizeof(float))), free);
        if (!values) throw std::bad_alloc();
        CN_TRY(decode(path, *in, l, [&](uint32_t row, uint32_t rows, const float *band) {
            for (uint32_t y = row; y < row + rows; y++)
                for (uint32_t x = 0; x < l.width; x++, band += channels)
                    std::copy(band, band + channels, values.get() + channels * oriented(l, x, y));
        }));
        map->width = l.out_width();
        map->height = l.out_height();
        map->bits = spec.format.is_floating_point() ? 0 : static_cast<int>(8 * spec.format.size());
        map->values = values.release();
        return CN_OK;
    });
}

extern "C" cn_status cn_oiio_write_png(const char *path, const float *pixels, uint32_t width, uint32_t height,
                                       int channels, const cn_oiio_attribute *attributes)
{
    return writing(path, [&] {
        OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), channels, OIIO::TypeDesc::UINT8);
        spec.attribute("oiio:ColorSpace", "sRGB");
        spec.attribute("oiio:UnassociatedAlpha", 1); // the library would divide the colours by alpha
        set_attributes(spec, attributes);
        const size_t n = static_cast<size_t>(width) * height * static_cast<size_t>(channels);
        return write(path, spec, OIIO::TypeDesc::UINT8, to_bytes(pixels, n).data());
    });
}

extern "C" cn_status cn_oiio_encode(cn_oiio_encoding encoding, const float *rgb, uint32_t width, uint32_t height,
                                    uint8_t **bytes, size_t *size)
{
    *bytes = nullptr;
    return writing("a picture", [&] {
        return cn_oiio_encode_bytes(encoding, to_bytes(rgb, size_t(3) * width * height).data(), width, height, bytes,
                                    size);
    });
}

extern "C" cn_status cn_oiio_encode_bytes(cn_oiio_encoding encoding, const uint8_t *rgb, uint32_t width,
                                          uint32_t height, uint8_t **bytes, size_t *size)
{
    const char *name = encoding.jpeg ? "picture.jpg" : "picture.png"; // names the format; no file is made
    *bytes = nullptr;
    *size = 0;
    return writing(name, [&] {
        OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), 3, OIIO::TypeDesc::UINT8);
        spec.attribute("oiio:ColorSpace", "sRGB");
        if (encoding.jpeg) spec.attribute("Compression", "jpeg:" + std::to_string(encoding.quality));
        if (encoding.full_chroma) spec.attribute("jpeg:subsampling", "4:4:4");
        std::vector<unsigned char> memory;
        OIIO::Filesystem::IOVecOutput proxy(memory);
        auto out = OIIO::ImageOutput::create(name);
        const bool good = out && out->set_ioproxy(&proxy) && out->open(name, spec) &&
                          out->write_image(OIIO::TypeDesc::UINT8, rgb) && out->close();
        if (!good)
            return cn_fail(CN_ERR_IO, "a picture cannot be encoded: %s",
                           out ? out->geterror().c_str() : OIIO::geterror().c_str());
        *bytes = static_cast<uint8_t *>(malloc(memory.size()));
        if (!*bytes) throw std::bad_alloc();
        std::memcpy(*bytes, memory.data(), memory.size());
        *size = memory.size();
        return CN_OK;
    });
}

extern "C" cn_status cn_oiio_write_jpeg(const char *path, const float *rgb, uint32_t width, uint32_t height,
                                        const cn_oiio_attribute *attributes)
{
    return writing(path, [&] {
        OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), 3, OIIO::TypeDesc::UINT8);
        spec.attribute("oiio:ColorSpace", "sRGB");
        spec.attribute("Compression", "jpeg:95");
        set_attributes(spec, attributes);
        return write(path, spec, OIIO::TypeDesc::FLOAT, rgb);
    });
}

extern "C" cn_status cn_oiio_copy_as_jpeg(const char *from, const char *to, const cn_oiio_attribute *attributes)
{
    std::vector<float> rgb;
    layout l;
    const cn_status read = reading(from, [&] {
        cn_status status;
        auto in = open(from, &status);
        if (!in) return status;
        CN_TRY(layout_of(from, in->spec(), &l));
        rgb.resize(static_cast<size_t>(l.width) * l.height * 3);
        const uint32_t green = l.channels < 3 ? 0 : 1, blue = l.channels < 3 ? 0 : 2;
        CN_TRY(decode(from, *in, l, [&](uint32_t row, uint32_t rows, const float *band) {
            float *to_rgb = rgb.data() + static_cast<size_t>(row) * l.width * 3;
            for (size_t i = 0; i < static_cast<size_t>(rows) * l.width; i++, band += l.channels, to_rgb += 3)
                to_rgb[0] = band[0], to_rgb[1] = band[green], to_rgb[2] = band[blue];
        }));
        if (in->spec().format.is_floating_point()) encode_linear(rgb);
        return CN_OK;
    });
    CN_TRY(read);
    return cn_oiio_write_jpeg(to, rgb.data(), l.width, l.height, attributes);
}

extern "C" cn_status cn_oiio_write_tiff(const char *path, const float *rgb, uint32_t width, uint32_t height,
                                        const cn_oiio_attribute *attributes)
{
    return writing(path, [&] {
        OIIO::ImageSpec spec(static_cast<int>(width), static_cast<int>(height), 3, OIIO::TypeDesc::UINT16);
        spec.attribute("oiio:ColorSpace", "sRGB");
        set_attributes(spec, attributes);
        return write(path, spec, OIIO::TypeDesc::FLOAT, rgb);
    });
}

extern "C" cn_status cn_oiio_write_exr_layers(const char *path, const cn_oiio_exr *exr,
                                              const cn_oiio_attribute *attributes)
{
    return writing(path, [&] {
        OIIO::ImageSpec spec(static_cast<int>(exr->width), static_cast<int>(exr->height), 4, OIIO::TypeDesc::FLOAT);
        spec.channelnames = { "R", "G", "B", "A" };
        spec.channelformats.assign(4, OIIO::TypeDesc::HALF);
        std::vector<cn_oiio_channel> further;
        if (exr->depth) {
            further.push_back({ "Z", exr->depth, 1 });
            spec.z_channel = 4;
        }
        for (const cn_oiio_channel *c = exr->channels; c && c->name; c++)
            further.push_back(*c);
        for (const cn_oiio_channel &c : further) {
            spec.channelnames.push_back(c.name);
            spec.channelformats.push_back(OIIO::TypeDesc::FLOAT);
        }
        spec.nchannels += static_cast<int>(further.size());
        spec.alpha_channel = 3;
        spec.attribute("compression", "zip");
        spec.attribute("chromaticities", OIIO::TypeDesc(OIIO::TypeDesc::FLOAT, 8), kAP1);
        spec.attribute("DateTime", ""); // else the library writes the time, and equal pictures would differ in bytes
        set_attributes(spec, attributes);
        const size_t channels = static_cast<size_t>(spec.nchannels), n = static_cast<size_t>(exr->width) * exr->height;
        std::vector<float> all(n * channels);
        for (size_t i = 0; i < n; i++) {
            float *p = &all[i * channels];
            for (int c = 0; c < 4; c++)
                p[c] = exr->rgba[4 * i + c] > kHalfMost ? kHalfMost : exr->rgba[4 * i + c];
            for (size_t c = 0; c < further.size(); c++)
                p[4 + c] = further[c].values[i * further[c].stride];
        }
        return write(path, spec, OIIO::TypeDesc::FLOAT, all.data());
    });
}

extern "C" cn_status cn_oiio_write_exr(const char *path, const float *rgba, const float *depth, uint32_t width,
                                       uint32_t height, const cn_oiio_attribute *attributes)
{
    const cn_oiio_exr exr = { rgba, depth, width, height, nullptr };
    return cn_oiio_write_exr_layers(path, &exr, attributes);
}
