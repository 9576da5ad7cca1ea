/* Who may speak to the server: by the headers Host and Origin, and by a token. Pure functions, for any thread. */
#ifndef CONURB_VIEW_GUARD_H
#define CONURB_VIEW_GUARD_H
#include "conurb/base.h"

enum { CN_TOKEN_SIZE = 33 };

/* 128 random bits as hex. CN_ERR_IO when the system gives none. */
CN_NODISCARD cn_status cn_guard_make_token(char token[CN_TOKEN_SIZE]);
/* Takes as long for a wrong token as for the right one of the same length. */
bool cn_guard_same_token(const char *given, const char *token);
/* Whether an address to listen on is of this machine alone. */
bool cn_guard_is_loopback(const char *address);
/* Whether the header Host names this server. Without that check a foreign page could reach it by a name of its own that
 * it points to this machine's address (DNS rebinding). On loopback: localhost and loopback addresses, at any port, for
 * ssh -L has its own. Else also any literal address, `address`, and the machine's own name. */
bool cn_guard_knows_host(const char *host, const char *address, const char *machine);
/* Whether the header Origin ("" when there is none, as without a browser) is a page of the same host and port. */
bool cn_guard_knows_origin(const char *origin, const char *host);
/* The token of a Cookie header, or "". */
void cn_guard_cookie_token(const char *cookie, char token[CN_TOKEN_SIZE]);
#define CN_GUARD_COOKIE "conurb_token"
#endif
