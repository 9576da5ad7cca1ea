/* Any bytes as messages and HTTP headers that `conurb view` receives. */
#include "view/guard.h"
#include "view/request.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    cn_ask ask;
    if (cn_ask_parse(&ask, (const char *)data, size) == CN_OK) {
        /* A request that is accepted can be rendered. */
        const bool picture = ask.kind == CN_ASK_VIEW;
        if (picture && (!ask.camera.width || !ask.camera.height || !isfinite(ask.camera.params[0]))) abort();
        if ((ask.kind == CN_ASK_SAVE || ask.kind == CN_ASK_LOAD) && strchr(ask.name, '/')) abort();
        cn_ask_deinit(&ask);
    }
    if (cn_ask_parse_upload(&ask, data, size) == CN_OK) {
        if (ask.kind != CN_ASK_FIT || !ask.n_bytes || strchr(ask.name, '/')) abort();
        cn_ask_deinit(&ask);
    }
    char *text = calloc(1, size + 1), token[CN_TOKEN_SIZE];
    if (!text) return 0;
    memcpy(text, data, size);
    (void)cn_guard_knows_host(text, "127.0.0.1", "machine");
    (void)cn_guard_knows_host(text, "0.0.0.0", "machine.site.org");
    (void)cn_guard_knows_origin(text, "localhost:7007");
    (void)cn_guard_same_token(text, "0123456789abcdef0123456789abcdef");
    cn_guard_cookie_token(text, 7007, token);
    free(text);
    return 0;
}
