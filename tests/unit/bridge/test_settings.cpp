// The libraries behind the bridge have settings of the whole process. They belong to the program: the bridge leaves
// them alone, until the program says that the process is Conurb's own.
#include "bridge/exiv2.h"
#include "bridge/ocio.h"
#include "bridge/oiio.h"

#include <OpenColorIO/OpenColorIO.h>
#include <OpenImageIO/imageio.h>
#include <exiv2/exiv2.hpp>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace OCIO = OCIO_NAMESPACE;

namespace
{

int failed = 0;
void expect(bool good, const char *what)
{
    if (good) return;
    failed++;
    std::printf("FAILED: %s\n", what);
}

int setting(const char *name)
{
    int value = -1;
    OIIO::getattribute(name, value);
    return value;
}

int heard = 0;
void hear(int, const char *)
{
    heard++;
}

void check_oiio(const std::string &folder)
{
    OIIO::attribute("threads", 3);
    OIIO::attribute("exr_threads", 2);
    const std::vector<float> pixels(16 * 16 * 4, 0.5f);
    const std::string exr = folder + "/a.exr", png = folder + "/a.png";
    float *rgba;
    uint32_t width, height;
    expect(cn_oiio_write_exr(exr.c_str(), pixels.data(), nullptr, 16, 16, nullptr) == CN_OK, "an EXR is written");
    expect(cn_oiio_write_png(png.c_str(), pixels.data(), 16, 16, 4, nullptr) == CN_OK, "a PNG is written");
    expect(cn_oiio_read_rgba(exr.c_str(), &rgba, &width, &height) == CN_OK, "the EXR is read");
    free(rgba);
    expect(setting("threads") == 3 && setting("exr_threads") == 2, "OpenImageIO's threads are left alone");
    cn_oiio_own_process();
    expect(setting("threads") == 1 && setting("exr_threads") == 1, "the process is Conurb's own: one thread");
}

void check_ocio()
{
    OCIO::SetLoggingLevel(OCIO::LOGGING_LEVEL_WARNING);
    cn_ocio *ocio = nullptr;
    expect(cn_ocio_create(&ocio, "/no/such/config.ocio", nullptr) == CN_ERR_CONFIG, "a config that is not there");
    expect(OCIO::GetLoggingLevel() == OCIO::LOGGING_LEVEL_WARNING, "OpenColorIO's logging is left alone");
    cn_ocio_destroy(&ocio);
    cn_ocio_own_process();
    expect(OCIO::GetLoggingLevel() == OCIO::LOGGING_LEVEL_NONE, "the process is Conurb's own: no log");
}

// EXIF whose only folder ends beyond the file: exiv2 warns.
void write_broken(const std::string &path)
{
    const std::vector<float> grey(8 * 8 * 3, 0.5f);
    expect(cn_oiio_write_jpeg(path.c_str(), grey.data(), 8, 8, nullptr) == CN_OK, "a JPEG is written");
    std::ifstream in(path, std::ios::binary);
    std::string all((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
    std::string exif("Exif\0\0II*\0\10\0\0\0\377\377", 16);
    const size_t length = exif.size() + 2;
    const char head[4] = { '\xff', '\xe1', static_cast<char>(length >> 8), static_cast<char>(length) };
    all.insert(2, std::string(head, 4) + exif);
    std::ofstream(path, std::ios::binary) << all;
}

void check_exiv2(const std::string &folder)
{
    const std::string path = folder + "/broken.jpg";
    cn_exif exif;
    write_broken(path);
    Exiv2::LogMsg::setHandler(hear);
    const auto level = Exiv2::LogMsg::level();
    Exiv2::ImageFactory::open(path)->readMetadata();
    expect(heard > 0, "exiv2 warns of this file");
    heard = 0;
    expect(cn_exiv2_read(path.c_str(), &exif) != CN_ERR_INTERNAL && heard == 0, "Conurb's own calls are silent");
    Exiv2::ImageFactory::open(path)->readMetadata();
    expect(heard > 0, "the program's own calls reach its handler");
    expect(Exiv2::LogMsg::level() == level, "exiv2's level is left alone");
}

} // namespace

int main()
{
    char name[] = "/tmp/conurb-settings-XXXXXX";
    if (!mkdtemp(name)) return 1;
    check_oiio(name);
    check_ocio();
    check_exiv2(name);
    for (const char *file : { "a.exr", "a.png", "broken.jpg" })
        std::remove((std::string(name) + "/" + file).c_str());
    std::remove(name);
    return failed ? 1 : 0;
}
