#include "view/server.h"

#include "base/clock.h"
#include "view/pages.h"

#include <libwebsockets.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

_Static_assert(CN_OUT_ROOM >= LWS_PRE, "messages keep too little room for libwebsockets");

enum { CHUNK = 16384, PIECE = 65536 /* of a message, at most */, TICK_US = 200000 };

struct cn_server {
    struct lws_context *context;
    struct lws_vhost *vhost;
    cn_server_options options;
    char machine[256];
    unsigned connections;
    lws_sorted_usec_list_t tick;
    struct lws *pages[CN_SESSION_MAX]; /* connections of the sessions in use */
    const struct connection *upload;   /* the one that sends a photo, or NULL; and since when */
    double upload_s;
    struct lws_protocols protocols[2];
};

/* State of a connection; zeroed by libwebsockets. */
typedef struct connection {
    const cn_page *page; /* over HTTP: what is being sent */
    size_t sent, size;
    bool head_only;
    cn_session *session; /* over WebSocket */
    char *message;       /* the part received so far */
    size_t length, room;
    bool refused; /* the message is a photo, and is not taken; its end is waited for */
    cn_out *out;  /* the message that is being sent, and how much of it was */
    size_t at;
} connection;

/* ---- access control ---- */

static bool header(struct lws *wsi, enum lws_token_indexes token, char *out, size_t size)
{
    out[0] = '\0';
    if (lws_hdr_total_length(wsi, token) >= (int)size) return false;
    return lws_hdr_copy(wsi, out, (int)size, token) >= 0;
}

static bool has_token(const cn_server *s, struct lws *wsi)
{
    char cookie[2048], given[CN_TOKEN_SIZE], query[64] = "";
    if (!s->options.token) return true;
    const char *value = lws_get_urlarg_by_name(wsi, "token=", query, sizeof query);
    if (value && cn_guard_same_token(value, s->options.token)) return true;
    if (!header(wsi, WSI_TOKEN_HTTP_COOKIE, cookie, sizeof cookie)) return false;
    cn_guard_cookie_token(cookie, cn_server_port(s), given);
    return cn_guard_same_token(given, s->options.token);
}

/* 0, or the HTTP status of a refusal. */
static unsigned refusal(const cn_server *s, struct lws *wsi, char host[512])
{
    char origin[512];
    if (!header(wsi, WSI_TOKEN_HOST, host, 512) || !cn_guard_knows_host(host, s->options.host, s->machine))
        return HTTP_STATUS_FORBIDDEN;
    if (!header(wsi, WSI_TOKEN_ORIGIN, origin, sizeof origin) || !cn_guard_knows_origin(origin, host))
        return HTTP_STATUS_FORBIDDEN;
    return has_token(s, wsi) ? 0 : HTTP_STATUS_UNAUTHORIZED;
}

/* ---- files of the page ---- */

static int add(struct lws *wsi, const char *name, const char *value, unsigned char **at, unsigned char *end)
{
    return lws_add_http_header_by_name(wsi, (const unsigned char *)name, (const unsigned char *)value,
                                       (int)strlen(value), at, end);
}

/* Allow only this server's files and scripts, and no frame around the page. */
static int add_policy(struct lws *wsi, const char *host, unsigned char **at, unsigned char *end)
{
    char policy[1024];
    snprintf(policy, sizeof policy,
             "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; media-src blob:; "
             "connect-src 'self' ws://%s wss://%s; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
             host, host);
    return add(wsi, "content-security-policy:", policy, at, end) ||
           add(wsi, "x-content-type-options:", "nosniff", at, end) || add(wsi, "x-frame-options:", "DENY", at, end) ||
           add(wsi, "referrer-policy:", "no-referrer", at, end) ||
           add(wsi, "cross-origin-opener-policy:", "same-origin", at, end) ||
           add(wsi, "cross-origin-resource-policy:", "same-origin", at, end) ||
           add(wsi, "cache-control:", "no-store", at, end);
}

static int begin_page(const cn_server *s, struct lws *wsi, connection *c, const char *host)
{
    unsigned char buffer[LWS_PRE + 4096], *start = buffer + LWS_PRE, *at = start, *end = buffer + sizeof buffer - 1;
    char cookie[128], name[CN_GUARD_COOKIE_SIZE];
    c->size = strlen(c->page->text);
    c->sent = 0;
    if (lws_add_http_common_headers(wsi, HTTP_STATUS_OK, c->page->type, c->size, &at, end) ||
        add_policy(wsi, host, &at, end))
        return 1;
    if (s->options.token) {
        /* The cookie is needed because the URLs of the page's files have no token. */
        cn_guard_cookie_name(cn_server_port(s), name);
        snprintf(cookie, sizeof cookie, "%s=%s; Path=/; HttpOnly; SameSite=Strict", name, s->options.token);
        if (add(wsi, "set-cookie:", cookie, &at, end)) return 1;
    }
    if (lws_finalize_write_http_header(wsi, start, &at, end)) return 1;
    if (c->head_only) return lws_http_transaction_completed(wsi) ? -1 : 0;
    lws_callback_on_writable(wsi);
    return 0;
}

static int on_http(const cn_server *s, struct lws *wsi, connection *c, const char *path)
{
    char host[512];
    const unsigned no = refusal(s, wsi, host);
    const bool get = lws_hdr_total_length(wsi, WSI_TOKEN_GET_URI) > 0;
    c->head_only = lws_hdr_total_length(wsi, WSI_TOKEN_HEAD_URI) > 0;
    c->page = cn_page_find(path);
    const unsigned status = no                      ? no
                            : !get && !c->head_only ? HTTP_STATUS_METHOD_NOT_ALLOWED
                            : !c->page              ? HTTP_STATUS_NOT_FOUND
                                                    : 0;
    if (!status) return begin_page(s, wsi, c, host);
    const char *why = status == HTTP_STATUS_UNAUTHORIZED
                          ? "Open the address that conurb view printed: it holds a token."
                      : status == HTTP_STATUS_FORBIDDEN
                          ? "This server is not known by that name. Open the address that conurb view printed."
                          : NULL;
    c->page = NULL;
    if (lws_return_http_status(wsi, status, why)) return -1;
    return lws_http_transaction_completed(wsi) ? -1 : 0;
}

static int go_on_with_page(struct lws *wsi, connection *c)
{
    unsigned char buffer[LWS_PRE + CHUNK];
    if (!c->page) return 0;
    const size_t left = c->size - c->sent, n = left < CHUNK ? left : CHUNK;
    const bool last = n == left;
    memcpy(buffer + LWS_PRE, c->page->text + c->sent, n);
    if (lws_write(wsi, buffer + LWS_PRE, n, last ? LWS_WRITE_HTTP_FINAL : LWS_WRITE_HTTP) < (int)n) return -1;
    c->sent += n;
    if (last) {
        c->page = NULL;
        return lws_http_transaction_completed(wsi) ? -1 : 0;
    }
    lws_callback_on_writable(wsi);
    return 0;
}

/* ---- messages ---- */

static int on_open(cn_server *s, struct lws *wsi, connection *c)
{
    c->session = cn_session_take(s->options.live);
    if (!c->session) {
        static unsigned char why[] = "too many pages are open";
        lws_close_reason(wsi, LWS_CLOSE_STATUS_POLICY_VIOLATION, why, sizeof why - 1);
        return -1;
    }
    s->pages[c->session->index] = wsi;
    return 0;
}

static void take_message(const cn_server *s, connection *c, bool binary)
{
    cn_ask ask;
    const cn_status status = binary ? cn_ask_parse_upload(&ask, (const uint8_t *)c->message, c->length)
                                    : cn_ask_parse(&ask, c->message, c->length);
    if (status != CN_OK) {
        cn_session_send_failure(c->session, cn_session_visit(c->session), ask.id, cn_error_message());
        return;
    }
    if (ask.kind == CN_ASK_VIEW)
        cn_session_draw(c->session, &ask);
    else if (ask.kind == CN_ASK_CANCEL)
        cn_session_cancel(c->session, ask.slot);
    else
        s->options.on_ask(s->options.user, c->session, &ask);
    cn_ask_deinit(&ask);
}

static void end_message(cn_server *s, connection *c)
{
    if (s->upload == c) s->upload = NULL;
    free(c->message);
    c->message = NULL;
    c->length = 0;
    c->refused = false;
}

/* A photo that is too large, or that comes while another one does, is read to its end and thrown away, so that the page
 * can be told. True for the rest of such a message. */
static bool refuses(cn_server *s, connection *c, size_t n)
{
    const char *why = NULL;
    const bool other = s->upload && s->upload != c && cn_now_s() - s->upload_s < CN_SERVER_UPLOAD_S;
    if (other) why = "another photo is being sent; try again in a moment";
    if (c->length + n > CN_ASK_MAX_UPLOAD) why = "the photo has more than 32 MB; make it smaller";
    if (why && !c->refused) {
        end_message(s, c);
        c->refused = true;
        cn_session_send_failure(c->session, cn_session_visit(c->session), 0, why);
    } else if (!why && !c->refused && s->upload != c) {
        s->upload = c;
        s->upload_s = cn_now_s();
    }
    return c->refused;
}

/* Doubles the room, so that a large photo in many parts is not copied once for each part. */
static bool make_room(connection *c, size_t n)
{
    if (c->message && c->length + n < c->room) return true;
    const size_t room = 2 * (c->length + n + 1);
    char *longer = realloc(c->message, room);
    if (!longer) return false;
    c->message = longer;
    c->room = room;
    return true;
}

static int on_receive(cn_server *s, struct lws *wsi, connection *c, const void *in, size_t n)
{
    const bool binary = lws_frame_is_binary(wsi);
    /* Whoever sends is there. A page cannot answer a ping while it sends a large photo. */
    lws_validity_confirmed(wsi);
    const bool last = lws_is_final_fragment(wsi) && !lws_remaining_packet_payload(wsi);
    if (!c->session || (!binary && c->length + n > CN_ASK_MAX_BYTES)) return -1;
    if (binary && refuses(s, c, n)) {
        if (last) end_message(s, c);
        return 0;
    }
    if (!make_room(c, n)) return -1;
    if (n) memcpy(c->message + c->length, in, n);
    c->length += n;
    if (!last) return 0;
    take_message(s, c, binary);
    end_message(s, c);
    return 0;
}

/* Sends a piece of a message. Between two pieces pings find their way. */
static int on_writable(struct lws *wsi, connection *c)
{
    if (!c->session) return 0;
    if (!c->out) {
        c->out = cn_session_next(c->session);
        c->at = 0;
    }
    if (!c->out) return 0;
    const size_t left = c->out->size - c->at, n = left < PIECE ? left : PIECE;
    const bool first = c->at == 0, last = n == left;
    /* There is room for another piece because the page has read: it is there, however long the message takes. */
    if (!first) lws_validity_confirmed(wsi);
    const int kind = lws_write_ws_flags(c->out->binary ? LWS_WRITE_BINARY : LWS_WRITE_TEXT, first, last);
    /* What the library writes before a piece is over what was sent already. */
    if (lws_write(wsi, c->out->bytes + CN_OUT_ROOM + c->at, n, (enum lws_write_protocol)kind) < (int)n) return -1;
    c->at += n;
    if (last) {
        cn_out_destroy(c->out);
        c->out = NULL;
    }
    lws_callback_on_writable(wsi); /* another piece or message may wait */
    return 0;
}

static void on_close(cn_server *s, connection *c)
{
    end_message(s, c);
    cn_out_destroy(c->out);
    c->out = NULL;
    if (!c->session) return;
    s->pages[c->session->index] = NULL;
    cn_session_leave(c->session);
    c->session = NULL;
}

/* The loop was woken: ask for a write callback for each page with messages. */
static void look_at_pages(const cn_server *s)
{
    for (int i = 0; i < CN_SESSION_MAX; i++) {
        if (!s->pages[i]) continue;
        if (cn_session_overrun(&s->options.live->sessions[i]))
            lws_set_timeout(s->pages[i], PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
        else
            lws_callback_on_writable(s->pages[i]);
    }
}

/* ---- libwebsockets ---- */

static int callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t n)
{
    cn_server *s = lws_context_user(lws_get_context(wsi));
    connection *c = user;
    char host[512];
    switch ((int)reason) {
    case LWS_CALLBACK_FILTER_NETWORK_CONNECTION: return s->connections >= CN_SERVER_CONNECTIONS;
    case LWS_CALLBACK_WSI_CREATE: s->connections++; return 0;
    case LWS_CALLBACK_WSI_DESTROY: s->connections--; return 0;
    case LWS_CALLBACK_HTTP: return on_http(s, wsi, c, in);
    case LWS_CALLBACK_HTTP_WRITEABLE: return go_on_with_page(wsi, c);
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION: return refusal(s, wsi, host) ? -1 : 0;
    case LWS_CALLBACK_ESTABLISHED: return on_open(s, wsi, c);
    case LWS_CALLBACK_RECEIVE: return on_receive(s, wsi, c, in, n);
    case LWS_CALLBACK_SERVER_WRITEABLE: return on_writable(wsi, c);
    case LWS_CALLBACK_CLOSED: on_close(s, c); return 0;
    case LWS_CALLBACK_EVENT_WAIT_CANCELLED: look_at_pages(s); return 0;
    default: return 0;
    }
}

/* Wakes the loop regularly, so that it notices a signal. */
static void on_tick(lws_sorted_usec_list_t *tick)
{
    cn_server *s = lws_container_of(tick, cn_server, tick);
    lws_sul_schedule(s->context, 0, &s->tick, on_tick, TICK_US);
}

static void fill_protocols(cn_server *s)
{
    s->protocols[0] = (struct lws_protocols){
        .name = "conurb", .callback = callback, .per_session_data_size = sizeof(connection), .rx_buffer_size = CHUNK
    };
}

static cn_status listen_there(cn_server *s)
{
    static const lws_retry_bo_t idle = { .secs_since_valid_ping = CN_SERVER_PING_S,
                                         .secs_since_valid_hangup = CN_SERVER_HANG_UP_S };
    const cn_server_options *o = &s->options;
    const bool local = strcmp(o->host, "localhost") == 0, all = strcmp(o->host, "0.0.0.0") == 0;
    struct lws_context_creation_info info = { .port = o->port,
                                              .iface = all     ? NULL
                                                       : local ? "127.0.0.1"
                                                               : o->host,
                                              .protocols = s->protocols,
                                              .gid = -1,
                                              .uid = -1,
                                              .user = s,
                                              .timeout_secs = CN_SERVER_SILENT_S,
                                              .keepalive_timeout = CN_SERVER_SILENT_S,
                                              .retry_and_idle_policy = &idle,
                                              .max_http_header_data = 8192,
                                              .max_http_header_pool = CN_SERVER_CONNECTIONS,
                                              .vhost_name = "conurb",
                                              .options = LWS_SERVER_OPTION_EXPLICIT_VHOSTS |
                                                         LWS_SERVER_OPTION_FAIL_UPON_UNABLE_TO_BIND |
                                                         LWS_SERVER_OPTION_DISABLE_OS_CA_CERTS };
    if (!strchr(o->host, ':')) info.options |= LWS_SERVER_OPTION_DISABLE_IPV6;
    s->context = lws_create_context(&info);
    if (!s->context) return cn_fail(CN_ERR_NOMEM, "out of memory for the server");
    s->vhost = lws_create_vhost(s->context, &info);
    if (s->vhost && lws_get_vhost_listen_port(s->vhost) > 0) return CN_OK;
    return cn_fail(CN_ERR_IO,
                   "cannot listen on port %u of %s: another program uses it, or the address is not of this machine; "
                   "choose others with --port and --host",
                   (unsigned)o->port, o->host);
}

cn_status cn_server_create(cn_server **server, const cn_server_options *options)
{
    cn_server *s = *server = calloc(1, sizeof *s);
    if (!s) return cn_fail(CN_ERR_NOMEM, "out of memory for the server");
    s->options = *options;
    gethostname(s->machine, sizeof s->machine - 1);
    fill_protocols(s);
    /* The library must not print. */
    lws_set_log_level(0, NULL);
    const cn_status status = listen_there(s);
    if (status != CN_OK) cn_server_destroy(server);
    return status;
}

void cn_server_destroy(cn_server **server)
{
    cn_server *s = *server;
    if (!s) return;
    if (s->context) {
        lws_sul_schedule(s->context, 0, &s->tick, NULL, LWS_SET_TIMER_USEC_CANCEL);
        lws_context_destroy(s->context);
    }
    free(s);
    *server = NULL;
}

uint16_t cn_server_port(const cn_server *s)
{
    return (uint16_t)lws_get_vhost_listen_port(s->vhost);
}

void cn_server_run(cn_server *s, const cn_context *ctx)
{
    lws_sul_schedule(s->context, 0, &s->tick, on_tick, TICK_US);
    while (!cn_stopping(ctx) && lws_service(s->context, 0) >= 0)
        continue;
}

void cn_server_wake(cn_server *s)
{
    if (s->context) lws_cancel_service(s->context);
}
