// exiv2 behind bridge/exiv2.h. Every exception stops here.
#include "bridge/exiv2.h"

#include "base/number.h"

#include <exiv2/exiv2.hpp>

#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <limits>
#include <mutex>
#include <new>
#include <string>

namespace
{

const double kNaN = std::numeric_limits<double>::quiet_NaN();

thread_local bool reading_here = false;
Exiv2::LogMsg::Handler handler_before = nullptr;

// exiv2 has one log handler for the whole process. This one drops the messages of threads that are in cn_exiv2_read,
// and passes all others to the handler that was set before.
void forward_log(int level, const char *text)
{
    if (!reading_here && handler_before) handler_before(level, text);
}

void lock_xmp(void *lock, bool take)
{
    auto *mutex = static_cast<std::recursive_mutex *>(lock);
    if (take)
        mutex->lock();
    else
        mutex->unlock();
}

// exiv2 needs this call once, before threads use it. A second call does nothing.
void prepare()
{
    static std::recursive_mutex xmp_lock;
    static const bool done = [] {
        handler_before = Exiv2::LogMsg::handler();
        Exiv2::LogMsg::setHandler(forward_log);
        // Version 0.27 reads HEIC and AVIF only when asked to, and may be built without it.
#ifdef EXV_ENABLE_BMFF
        Exiv2::enableBMFF(true);
#endif
        return Exiv2::XmpParser::initialize(lock_xmp, &xmp_lock);
    }();
    (void)done;
}

struct silence {
    silence() { reading_here = true; }
    ~silence() { reading_here = false; }
};

bool has(const Exiv2::ExifData &data, const char *key)
{
    return data.findKey(Exiv2::ExifKey(key)) != data.end();
}

// NULL when absent or empty.
const Exiv2::Value *find(const Exiv2::ExifData &data, const char *key)
{
    const auto at = data.findKey(Exiv2::ExifKey(key));
    return at != data.end() && at->count() > 0 ? &at->value() : nullptr;
}

// exiv2's own toRational cuts unsigned numbers at 31 bits, and its toFloat keeps 24.
double number(const Exiv2::Value &value, long i)
{
    const auto at = static_cast<size_t>(i);
    if (const auto *u = dynamic_cast<const Exiv2::URationalValue *>(&value))
        return static_cast<double>(u->value_[at].first) / u->value_[at].second;
    if (const auto *s = dynamic_cast<const Exiv2::RationalValue *>(&value))
        return static_cast<double>(s->value_[at].first) / s->value_[at].second;
    if (const auto *d = dynamic_cast<const Exiv2::DoubleValue *>(&value)) return d->value_[at];
    if (const auto *u = dynamic_cast<const Exiv2::ULongValue *>(&value)) return u->value_[at];
    const bool is_text = value.typeId() == Exiv2::asciiString || value.typeId() == Exiv2::comment;
    return is_text ? kNaN : static_cast<double>(value.toFloat(i)); // short integers, or a float
}

// NaN when absent, zero or made of 0/0.
double positive(const Exiv2::ExifData &data, const char *key)
{
    const Exiv2::Value *value = find(data, key);
    const double x = value ? number(*value, 0) : kNaN;
    return std::isfinite(x) && x > 0 ? x : kNaN;
}

std::string text(const Exiv2::ExifData &data, const char *key)
{
    const Exiv2::Value *value = find(data, key);
    const std::string all = value ? value->toString() : std::string();
    return all.substr(0, all.find('\0'));
}

template <size_t N> void copy(char (&out)[N], const std::string &from)
{
    snprintf(out, N, "%s", from.c_str());
}

// Degrees, minutes, seconds. NaN when absent or not finite.
double angle(const Exiv2::ExifData &data, const char *key)
{
    const Exiv2::Value *value = find(data, key);
    double degrees = value ? number(*value, 0) : kNaN, unit = 1;
    // Minutes or seconds written as 0/0 mean "not used".
    for (long i = 1; value && i < 3 && i < value->count(); i++) {
        const double part = number(*value, i);
        unit *= 60;
        degrees += std::isfinite(part) ? part / unit : 0;
    }
    return std::isfinite(degrees) ? degrees : kNaN;
}

bool starts_with(const Exiv2::ExifData &data, const char *key, char upper)
{
    const std::string all = text(data, key);
    return !all.empty() && std::toupper(static_cast<unsigned char>(all[0])) == upper;
}

// The reference is a byte. Some writers store it as text. When it is absent, the height is above sea level.
bool below_sea(const Exiv2::ExifData &data)
{
    const Exiv2::Value *value = find(data, "Exif.GPSInfo.GPSAltitudeRef");
    if (!value) return false;
    if (value->typeId() != Exiv2::asciiString) return number(*value, 0) == 1;
    const std::string all = value->toString();
    return !all.empty() && (all[0] == '1' || all[0] == '\1');
}

void read_gps(const Exiv2::ExifData &data, cn_exif *exif)
{
    static const char latitude[] = "Exif.GPSInfo.GPSLatitude", longitude[] = "Exif.GPSInfo.GPSLongitude";
    const double lat = angle(data, latitude), lon = angle(data, longitude);
    exif->has_latlon = cn_exif_is_place(lat, lon);
    exif->has_bad_gps = (has(data, latitude) || has(data, longitude)) && !exif->has_latlon;
    if (exif->has_latlon) {
        exif->latitude_deg = starts_with(data, "Exif.GPSInfo.GPSLatitudeRef", 'S') ? -lat : lat;
        exif->longitude_deg = starts_with(data, "Exif.GPSInfo.GPSLongitudeRef", 'W') ? -lon : lon;
    }
    const Exiv2::Value *altitude = find(data, "Exif.GPSInfo.GPSAltitude");
    const double metres = altitude ? number(*altitude, 0) : kNaN;
    exif->has_altitude = std::isfinite(metres);
    if (exif->has_altitude) exif->altitude_m = below_sea(data) ? -std::fabs(metres) : metres;
}

// Heights are about twice as uncertain as places.
const double kVertical = 2;

bool plausible(double sigma_m)
{
    return sigma_m > 0 && sigma_m < 1e4;
}

// By the whole name: a key of a namespace that exiv2 has not met cannot be looked up.
double xmp_number(const Exiv2::XmpData &data, const char *key)
{
    for (const auto &entry : data)
        if (entry.key() == key) return cn_parse_double(entry.toString().c_str(), nullptr);
    return kNaN;
}

std::string xmp_text(const Exiv2::XmpData &data, const char *key)
{
    for (const auto &entry : data)
        if (entry.key() == key) return entry.toString();
    return "";
}

// DJI's receivers state each axis; Pix4D's namespace has a horizontal and a vertical value, EXIF a horizontal one.
void read_accuracy(const Exiv2::ExifData &data, const Exiv2::XmpData &xmp, cn_exif *exif)
{
    double sigma[3] = { xmp_number(xmp, "Xmp.drone-dji.RtkStdLon"), xmp_number(xmp, "Xmp.drone-dji.RtkStdLat"),
                        xmp_number(xmp, "Xmp.drone-dji.RtkStdHgt") };
    if (!plausible(sigma[0])) {
        sigma[0] = sigma[1] = xmp_number(xmp, "Xmp.Camera.GPSXYAccuracy");
        sigma[2] = xmp_number(xmp, "Xmp.Camera.GPSZAccuracy");
    }
    if (!plausible(sigma[0])) {
        // Older versions of exiv2 have no name for this tag.
        const double named = positive(data, "Exif.GPSInfo.GPSHPositioningError");
        sigma[0] = sigma[1] = std::isfinite(named) ? named : positive(data, "Exif.GPSInfo.0x001f");
        sigma[2] = kNaN;
    }
    if (!plausible(sigma[0]) || !plausible(sigma[1])) return;
    if (!plausible(sigma[2])) sigma[2] = kVertical * std::fmax(sigma[0], sigma[1]);
    for (int i = 0; i < 3; i++)
        exif->gps_sigma_m[i] = sigma[i];
}

void read_all(const Exiv2::ExifData &data, cn_exif *exif)
{
    read_gps(data, exif);
    exif->exposure_s = positive(data, "Exif.Photo.ExposureTime");
    exif->iso = positive(data, "Exif.Photo.ISOSpeedRatings");
    exif->f_number = positive(data, "Exif.Photo.FNumber");
    exif->focal_mm = positive(data, "Exif.Photo.FocalLength");
    exif->focal_35mm = positive(data, "Exif.Photo.FocalLengthIn35mmFilm");
    copy(exif->datetime, text(data, "Exif.Photo.DateTimeOriginal"));
    copy(exif->subsec, text(data, "Exif.Photo.SubSecTimeOriginal"));
    copy(exif->offset, text(data, "Exif.Photo.OffsetTimeOriginal"));
    // The option file of DCF 2.0. Some cameras mark Adobe RGB photos like this, without an ICC profile.
    const Exiv2::Value *space = find(data, "Exif.Photo.ColorSpace");
    exif->is_adobe_rgb = space && number(*space, 0) == 65535 && text(data, "Exif.Iop.InteroperabilityIndex") == "R03";
    copy(exif->make, text(data, "Exif.Image.Make"));
    copy(exif->model, text(data, "Exif.Image.Model"));
}

cn_exif unknown()
{
    cn_exif exif = cn_exif();
    exif.exposure_s = exif.iso = exif.f_number = exif.focal_mm = exif.focal_35mm = kNaN;
    return exif;
}

} // namespace

extern "C" cn_status cn_exiv2_read(const char *path, cn_exif *exif)
{
    *exif = unknown();
    try {
        prepare();
        const silence quiet;
        const auto image = Exiv2::ImageFactory::open(Exiv2::BasicIo::AutoPtr(new Exiv2::FileIo(path)));
        if (!image.get()) return cn_fail(CN_ERR_FORMAT, "%s is of a kind that exiv2 does not read", path);
        image->readMetadata();
        if (image->exifData().empty() && image->xmpData().empty())
            return cn_fail(CN_ERR_FORMAT, "%s holds no EXIF", path);
        read_all(image->exifData(), exif);
        read_accuracy(image->exifData(), image->xmpData(), exif);
        copy(exif->projection, xmp_text(image->xmpData(), "Xmp.GPano.ProjectionType"));
        return CN_OK;
    } catch (const std::bad_alloc &) {
        return cn_fail(CN_ERR_NOMEM, "%s: out of memory while its EXIF was read", path);
    } catch (const std::exception &e) {
        *exif = unknown();
        return cn_fail(CN_ERR_FORMAT, "the EXIF of %s cannot be read: %s", path, e.what());
    } catch (...) {
        *exif = unknown();
        return cn_fail(CN_ERR_FORMAT, "the EXIF of %s cannot be read", path);
    }
}

extern "C" cn_status cn_exiv2_read_icc(const char *path, void **profile, size_t *size)
{
    *profile = nullptr;
    *size = 0;
    try {
        prepare();
        const silence quiet;
        const auto image = Exiv2::ImageFactory::open(Exiv2::BasicIo::AutoPtr(new Exiv2::FileIo(path)));
        if (!image.get()) return CN_OK; // of a kind that exiv2 does not read
        image->readMetadata();
        const Exiv2::DataBuf *icc = image->iccProfileDefined() ? image->iccProfile() : nullptr;
        if (!icc || icc->size_ <= 0) return CN_OK;
        *profile = malloc(static_cast<size_t>(icc->size_));
        if (!*profile) throw std::bad_alloc();
        *size = static_cast<size_t>(icc->size_);
        std::memcpy(*profile, icc->pData_, *size);
        return CN_OK;
    } catch (const std::bad_alloc &) {
        return cn_fail(CN_ERR_NOMEM, "%s: out of memory while its ICC profile was read", path);
    } catch (...) {
        return CN_OK; // damaged for exiv2; the colours are then taken as if there were no profile
    }
}

extern "C" cn_status cn_exiv2_mark_equirectangular(const char *path, uint32_t width, uint32_t height)
{
    try {
        prepare();
        const silence quiet;
        Exiv2::XmpProperties::registerNs("http://ns.google.com/photos/1.0/panorama/", "GPano");
        const auto image = Exiv2::ImageFactory::open(Exiv2::BasicIo::AutoPtr(new Exiv2::FileIo(path)));
        image->readMetadata();
        Exiv2::XmpData &xmp = image->xmpData();
        xmp["Xmp.GPano.ProjectionType"] = "equirectangular";
        xmp["Xmp.GPano.UsePanoramaViewer"] = "True";
        const std::string w = std::to_string(width), h = std::to_string(height);
        xmp["Xmp.GPano.FullPanoWidthPixels"] = xmp["Xmp.GPano.CroppedAreaImageWidthPixels"] = w;
        xmp["Xmp.GPano.FullPanoHeightPixels"] = xmp["Xmp.GPano.CroppedAreaImageHeightPixels"] = h;
        xmp["Xmp.GPano.CroppedAreaLeftPixels"] = xmp["Xmp.GPano.CroppedAreaTopPixels"] = "0";
        image->writeMetadata();
        return CN_OK;
    } catch (const std::exception &e) {
        return cn_fail(CN_ERR_IO, "the XMP of %s cannot be written: %s", path, e.what());
    } catch (...) {
        return cn_fail(CN_ERR_IO, "the XMP of %s cannot be written", path);
    }
}
