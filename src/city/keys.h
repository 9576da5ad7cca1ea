/* The keys of city.yaml. One table serves reading, checking and the file that `init` writes. */
#ifndef CONURB_CITY_KEYS_H
#define CONURB_CITY_KEYS_H
#include "city/settings.h"

typedef enum cn_key_kind {
    CN_KEY_WHOLE,      /* uint32_t */
    CN_KEY_WHOLE64,    /* uint64_t */
    CN_KEY_REAL,       /* double */
    CN_KEY_GB,         /* uint64_t bytes, written in units of 10^9 */
    CN_KEY_TEXT,       /* char *, owned by the config; empty is NULL */
    CN_KEY_PATH,       /* the same, made absolute from the city's folder */
    CN_KEY_PROGRAM,    /* the same, but a name without '/' is searched in PATH */
    CN_KEY_CHOICE,     /* an enum: one of `choices` */
    CN_KEY_SWITCH,     /* bool: on or off */
    CN_KEY_FIELD_TYPE, /* field.type: train.field of that type, at the quality's settings */
    CN_KEY_FIELD       /* a setting of train.field */
} cn_key_kind;

typedef struct cn_key_choice {
    const char *name;
    int value;
} cn_key_choice;

typedef struct cn_key {
    const char *section, *name;
    cn_key_kind kind;
    size_t offset;                /* offset of the value in cn_config */
    double least, most;           /* range of a number */
    const cn_key_choice *choices; /* of CN_KEY_CHOICE; a NULL name ends them */
    const char *sample;           /* what `init` writes when there is no default, or NULL */
    const char *comment;          /* what `init` writes beside it */
    bool names_settings;          /* when this key is given, a time budget does not choose the settings */
} cn_key;

typedef struct cn_key_section {
    const char *name, *comment;
} cn_key_section;
extern const cn_key_section cn_key_sections[];
extern const uint32_t cn_key_n_sections;

/* Key i of the table, section by section; false past the end. The keys of `effects` come from the effect registry. */
bool cn_key_at(uint32_t i, cn_key *key);
/* False when the section has no such key. */
bool cn_key_find(const char *section, const char *name, cn_key *key);
/* What `init` writes beside the key. */
void cn_key_comment(const cn_key *key, char *out, size_t size);
/* The value of a key in a config as city.yaml has it. Writes "" where there is none. */
void cn_key_print(const cn_key *key, const cn_config *config, char *out, size_t size);
/* Parses a value's text into the config; not for keys of `field`. False when the text is wrong: hint (size bytes) then
 * says what to give. */
bool cn_key_store(const cn_key *key, const char *text, const char *folder, cn_config *config, char *hint, size_t size);
/* What to give for this key: "give a number". */
void cn_key_hint(const cn_key *key, char *hint, size_t size);
/* Whether the config's number is in the key's range. *value: the number. True for keys of other kinds. */
bool cn_key_in_range(const cn_key *key, const cn_config *config, double *value);
#endif
