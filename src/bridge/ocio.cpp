// OpenColorIO behind bridge/ocio.h. The library's config caches processors under a lock of its own; CPU processors are
// const and thread-safe.
#include "bridge/ocio.h"

#include "base/number.h"

#include <OpenColorIO/OpenColorIO.h>

#include <cmath>
#include <cstddef>
#include <exception>
#include <new>
#include <sstream>
#include <string>
#include <vector>

namespace OCIO = OCIO_NAMESPACE;

struct cn_ocio {
    OCIO::ConstConfigRcPtr config;
    std::string name;
    std::vector<std::string> view_names, look_names;
    std::vector<const char *> views, looks;
};

namespace
{

// Configs and their tables are text with numbers, which are read in the C locale.
struct dots {
    locale_t before = cn_number_begin();
    ~dots() { cn_number_end(before); }
};

template <class F> cn_status guarded(const std::string &name, F f)
{
    const dots here;
    try {
        return f();
    } catch (const std::bad_alloc &) {
        return cn_fail(CN_ERR_NOMEM, "out of memory while converting colours");
    } catch (const std::exception &e) {
        return cn_fail(CN_ERR_CONFIG, "OpenColorIO config %s: %s", name.c_str(), e.what());
    } catch (...) {
        return cn_fail(CN_ERR_CONFIG, "OpenColorIO config %s cannot be used", name.c_str());
    }
}

void apply(const OCIO::ConstProcessorRcPtr &processor, float *pixels, size_t n, int stride)
{
    const auto cpu = processor->getDefaultCPUProcessor();
    // Three channels, because a fourth that is not a number would make the others invalid. Short rows, because the
    // library keeps a copy of a row.
    const ptrdiff_t pixel = stride * static_cast<ptrdiff_t>(sizeof(float));
    for (size_t i = 0; i < n;) {
        const size_t width = n - i < 1024 ? n - i : 1024, height = (n - i) / width;
        OCIO::PackedImageDesc image(pixels + i * static_cast<size_t>(stride), static_cast<long>(width),
                                    static_cast<long>(height), 3, OCIO::BIT_DEPTH_F32, sizeof(float), pixel,
                                    pixel * static_cast<ptrdiff_t>(width));
        cpu->apply(image);
        i += width * height;
    }
}

} // namespace

extern "C" void cn_ocio_own_process(void)
{
    OCIO::SetLoggingLevel(OCIO::LOGGING_LEVEL_NONE);
}

extern "C" cn_status cn_ocio_create(cn_ocio **out, const char *path, const char *text)
{
    *out = nullptr;
    const std::string name = path ? path : "(built in)";
    return guarded(name, [&] {
        auto ocio = new cn_ocio;
        *out = ocio;
        ocio->name = name;
        if (path) {
            ocio->config = OCIO::Config::CreateFromFile(path);
        } else {
            std::istringstream stream(text);
            ocio->config = OCIO::Config::CreateFromStream(stream);
        }
        ocio->config->validate();
        const char *display = ocio->config->getDefaultDisplay();
        const std::string first = ocio->config->getDefaultView(display);
        ocio->view_names.push_back(first);
        for (int i = 0; i < ocio->config->getNumViews(display); i++)
            if (const char *view = ocio->config->getView(display, i); first != view) ocio->view_names.push_back(view);
        for (const auto &v : ocio->view_names)
            ocio->views.push_back(v.c_str());
        ocio->views.push_back(nullptr);
        for (int i = 0; i < ocio->config->getNumLooks(); i++)
            ocio->look_names.push_back(ocio->config->getLookNameByIndex(i));
        for (const auto &l : ocio->look_names)
            ocio->looks.push_back(l.c_str());
        ocio->looks.push_back(nullptr);
        return CN_OK;
    });
}

extern "C" void cn_ocio_destroy(cn_ocio **ocio)
{
    delete *ocio;
    *ocio = nullptr;
}

extern "C" const char *cn_ocio_first_space(const cn_ocio *ocio, const char *const *names)
{
    try {
        for (; *names; names++)
            if (ocio->config->getColorSpace(*names)) return *names;
    } catch (...) { // the config lacks what the library cannot find
    }
    return nullptr;
}

extern "C" cn_status cn_ocio_convert(const cn_ocio *ocio, const char *from, const char *to, float *pixels, size_t n,
                                     int stride)
{
    return guarded(ocio->name, [&] {
        apply(ocio->config->getProcessor(from, to), pixels, n, stride);
        return CN_OK;
    });
}

extern "C" cn_status cn_ocio_display(const cn_ocio *ocio, const cn_ocio_look *look, float *pixels, size_t n, int stride)
{
    return guarded(ocio->name, [&] {
        auto group = OCIO::GroupTransform::Create();
        if (look->exposure_ev != 0) {
            const double gain = std::exp2(look->exposure_ev);
            const double m[16] = { gain, 0, 0, 0, 0, gain, 0, 0, 0, 0, gain, 0, 0, 0, 0, 1 };
            auto matrix = OCIO::MatrixTransform::Create();
            matrix->setMatrix(m);
            group->appendTransform(matrix);
        }
        if (look->look && *look->look) {
            auto transform = OCIO::LookTransform::Create();
            transform->setSrc(look->from);
            transform->setDst(look->from);
            transform->setLooks(look->look);
            group->appendTransform(transform);
        }
        auto display = OCIO::DisplayViewTransform::Create();
        display->setSrc(look->from);
        display->setDisplay(ocio->config->getDefaultDisplay());
        display->setView(look->view);
        group->appendTransform(display);
        apply(ocio->config->getProcessor(group), pixels, n, stride);
        return CN_OK;
    });
}

extern "C" const char *const *cn_ocio_views(const cn_ocio *ocio)
{
    return ocio->views.data();
}

extern "C" const char *const *cn_ocio_looks(const cn_ocio *ocio)
{
    return ocio->looks.data();
}
