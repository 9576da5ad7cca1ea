/* Access control of the server, by the headers Host and Origin and by a token. The functions keep no state; any
 * thread. */
#ifndef CONURB_VIEW_GUARD_H
#define CONURB_VIEW_GUARD_H
#include "conurb/base.h"

enum { CN_TOKEN_SIZE = 33 };

/* 128 random bits as hex. CN_ERR_IO when the system gives none. */
CN_NODISCARD cn_status cn_guard_make_token(char token[CN_TOKEN_SIZE]);
/* Compares tokens in constant time. */
bool cn_guard_same_token(const char *given, const char *token);
/* Whether only this machine can reach the address. */
bool cn_guard_is_loopback(const char *address);
/* Whether the header Host names this server. The check prevents DNS rebinding: a foreign page that reaches this
 * machine by a name of its own. On loopback: localhost and loopback addresses are allowed at any port, because ssh -L
 * has its own port. Otherwise also any literal address, `address`, and the machine's name. */
bool cn_guard_knows_host(const char *host, const char *address, const char *machine);
/* Whether the header Origin is of the same host and port. "" (no header, as without a browser) is allowed. */
bool cn_guard_knows_origin(const char *origin, const char *host);
/* The name of a server's cookie. Browsers send the cookies of a host to all its ports, so the name has the server's. */
enum { CN_GUARD_COOKIE_SIZE = 24 };
void cn_guard_cookie_name(uint16_t port, char name[CN_GUARD_COOKIE_SIZE]);
/* The token of a Cookie header for the server of that port, or "". */
void cn_guard_cookie_token(const char *cookie, uint16_t port, char token[CN_TOKEN_SIZE]);
#endif
