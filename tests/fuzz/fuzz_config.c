/* Any bytes as a city.yaml. */
#include "fuzz.h"

#include "city/config.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    cn_config config;
    fuzz_file("city.yaml", data, size);
    if (cn_config_load(&config, fuzz_home()) == CN_OK) {
        const cn_train_options options = cn_config_train(&config, CN_QUALITY_HIGH, 60);
        if (!config.photos || options.steps == 0) abort();
        cn_config_deinit(&config);
    } else if (!cn_error_message()[0]) {
        abort();
    }
    return 0;
}
