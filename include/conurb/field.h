/* conurb/field.h: the types of radiance field that a tile can be trained with, and their settings. Every function may
 * be called from any thread. */
#ifndef CONURB_FIELD_H
#define CONURB_FIELD_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef enum cn_quality {
    CN_QUALITY_PREVIEW,
    CN_QUALITY_STANDARD,
    CN_QUALITY_HIGH,
    CN_QUALITY_REFERENCE,
    /* A tile of at most 1 MB, for sending over slow lines. No time budget chooses it. */
    CN_QUALITY_COMPACT
} cn_quality;
enum { CN_QUALITIES = 5 };

enum { CN_FIELD_OPTIONS_MAX = 12, CN_FIELD_TYPE_SIZE = 16 };

/* One setting of a field type: a number with a name and a range. */
typedef struct cn_field_option {
    const char *name, *comment; /* comment: what it means, in a few words */
    double least, most;
    double preset[CN_QUALITIES]; /* one value for each quality */
    bool whole;                  /* whether only whole numbers are allowed */
} cn_field_option;

/* A field type with its settings. value[i] belongs to option i of the type. */
typedef struct cn_field_options {
    char type[CN_FIELD_TYPE_SIZE]; /* "hash", "dense" */
    double value[CN_FIELD_OPTIONS_MAX];
} cn_field_options;

/* Type i of the list of field types; false past the end. name and summary are constant strings. */
CN_API bool cn_field_type_at(uint32_t i, const char **name, const char **summary);
/* The *n options of a type, a constant array. NULL for an unknown type. */
CN_API const cn_field_option *cn_field_type_options(const char *type, uint32_t *n);
/* The settings of a type at a quality. CN_ERR_CONFIG: an unknown type; the message lists the known ones. */
CN_API CN_NODISCARD cn_status cn_field_options_preset(const char *type, cn_quality quality, cn_field_options *options);
/* Sets one option. CN_ERR_CONFIG: the type has no such option (the message names the type that has it), or the value
 * is out of range. */
CN_API CN_NODISCARD cn_status cn_field_options_set(cn_field_options *options, const char *name, double value);
/* The value of an option; NaN when the type has no such option. */
CN_API double cn_field_options_get(const cn_field_options *options, const char *name);
/* Writes all settings as text, "hash levels=16 ...", to out. Two fields have the same settings when their texts are
 * equal. The text is cut at size bytes. */
CN_API void cn_field_options_print(const cn_field_options *options, char *out, size_t size);
/* Bytes that the parameters of such a field take in an open tile; 0 when the settings are invalid. */
CN_API uint64_t cn_field_options_bytes(const cn_field_options *options);

#ifdef __cplusplus
}
#endif
#endif
