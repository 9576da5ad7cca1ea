#include "view/guard.h"

#include <arpa/inet.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/random.h>

cn_status cn_guard_make_token(char token[CN_TOKEN_SIZE])
{
    uint8_t bytes[(CN_TOKEN_SIZE - 1) / 2];
    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes)
        return cn_fail(CN_ERR_IO, "the system gave no random bytes for a token");
    for (size_t i = 0; i < sizeof bytes; i++)
        snprintf(token + 2 * i, 3, "%02x", bytes[i]);
    return CN_OK;
}

bool cn_guard_same_token(const char *given, const char *token)
{
    unsigned difference = strlen(given) != CN_TOKEN_SIZE - 1;
    char copy[CN_TOKEN_SIZE] = { 0 };
    snprintf(copy, sizeof copy, "%s", given);
    for (size_t i = 0; i < CN_TOKEN_SIZE - 1; i++)
        difference |= (unsigned)(unsigned char)copy[i] ^ (unsigned)(unsigned char)token[i];
    return difference == 0;
}

static bool is_literal(const char *address, bool *loopback)
{
    struct in_addr four;
    struct in6_addr six;
    *loopback = false;
    if (inet_pton(AF_INET, address, &four) == 1) {
        *loopback = (ntohl(four.s_addr) >> 24) == 127;
        return true;
    }
    if (inet_pton(AF_INET6, address, &six) != 1) return false;
    *loopback = IN6_IS_ADDR_LOOPBACK(&six);
    return true;
}

bool cn_guard_is_loopback(const char *address)
{
    bool loopback;
    return strcasecmp(address, "localhost") == 0 || (is_literal(address, &loopback) && loopback);
}

/* NAME, NAME:PORT, [SIX] or [SIX]:PORT; false for anything else. */
static bool split_host(const char *host, char name[256])
{
    const bool six = host[0] == '[';
    const char *end = six ? strchr(host, ']') : host + strcspn(host, ":");
    if (!end) return false;
    const size_t n = (size_t)(end - host) - six;
    if (!n || n > 255) return false;
    memcpy(name, host + six, n);
    name[n] = '\0';
    if (six) end++;
    if (!*end) return true;
    const size_t digits = strspn(end + 1, "0123456789");
    return *end == ':' && digits > 0 && digits <= 5 && end[1 + digits] == '\0';
}

bool cn_guard_knows_host(const char *host, const char *address, const char *machine)
{
    char name[256];
    bool loopback;
    if (!split_host(host, name)) return false;
    if (cn_guard_is_loopback(name)) return true;
    if (cn_guard_is_loopback(address)) return false;
    if (is_literal(name, &loopback) || strcasecmp(name, address) == 0) return true;
    /* Compares with the machine's name; either may have a domain. */
    const size_t n = strcspn(machine, ".");
    return n > 0 && strncasecmp(name, machine, n) == 0 && (name[n] == '\0' || strcasecmp(name, machine) == 0);
}

bool cn_guard_knows_origin(const char *origin, const char *host)
{
    if (!*origin) return true;
    if (strncmp(origin, "http://", 7) == 0) return strcasecmp(origin + 7, host) == 0;
    return strncmp(origin, "https://", 8) == 0 && strcasecmp(origin + 8, host) == 0;
}

void cn_guard_cookie_name(uint16_t port, char name[CN_GUARD_COOKIE_SIZE])
{
    snprintf(name, CN_GUARD_COOKIE_SIZE, "conurb_token_%u", (unsigned)port);
}

void cn_guard_cookie_token(const char *cookie, uint16_t port, char token[CN_TOKEN_SIZE])
{
    char name[CN_GUARD_COOKIE_SIZE];
    cn_guard_cookie_name(port, name);
    const size_t length = strlen(name);
    token[0] = '\0';
    for (const char *at = cookie; at; at = strchr(at, ';')) {
        at += strspn(at, "; ");
        if (strncmp(at, name, length) != 0 || at[length] != '=') continue;
        const char *value = at + length + 1;
        const size_t n = strcspn(value, "; ");
        if (n >= CN_TOKEN_SIZE) return;
        memcpy(token, value, n);
        token[n] = '\0';
        return;
    }
}
