/* conurb/field.h: the kinds of radiance field that a tile can be trained with, and their settings. */
#ifndef CONURB_FIELD_H
#define CONURB_FIELD_H
#include "conurb/base.h"
#ifdef __cplusplus
extern "C" {
#endif

typedef enum cn_quality { CN_QUALITY_PREVIEW, CN_QUALITY_STANDARD, CN_QUALITY_HIGH, CN_QUALITY_REFERENCE } cn_quality;
enum { CN_QUALITIES = 4 };

enum { CN_FIELD_OPTIONS_MAX = 12, CN_FIELD_TYPE_SIZE = 16 };

/* One setting of a type of field: a number with a name. */
typedef struct cn_field_option {
    const char *name, *comment; /* comment: for people, a few words */
    double least, most;
    double preset[CN_QUALITIES]; /* by quality */
    bool whole;                  /* a whole number */
} cn_field_option;

/* A type of field and its settings, by value: value[i] is that of the type's option i. */
typedef struct cn_field_options {
    char type[CN_FIELD_TYPE_SIZE]; /* "hash", "dense" */
    double value[CN_FIELD_OPTIONS_MAX];
} cn_field_options;

/* The list of types. name and summary are static. False past the end. For any thread. */
CN_API bool cn_field_type_at(uint32_t i, const char **name, const char **summary);
/* The options of a type, static; *n of them. NULL for an unknown type. */
CN_API const cn_field_option *cn_field_type_options(const char *type, uint32_t *n);
/* The settings of a type at a quality. CN_ERR_CONFIG for an unknown type: the message names those that there are. */
CN_API CN_NODISCARD cn_status cn_field_options_preset(const char *type, cn_quality quality, cn_field_options *options);
/* Sets one option. CN_ERR_CONFIG when the type has no such option (the message names the type that has it), or when the
 * value is out of its range. */
CN_API CN_NODISCARD cn_status cn_field_options_set(cn_field_options *options, const char *name, double value);
/* The value of an option; NaN when the type has no such option. */
CN_API double cn_field_options_get(const cn_field_options *options, const char *name);
/* All settings as text, "hash levels=16 ...": for keys of what depends on them. Cut at size bytes. */
CN_API void cn_field_options_print(const cn_field_options *options, char *out, size_t size);
/* Bytes of the parameters of such a field as an open tile holds them; 0 for settings that make no sense. */
CN_API uint64_t cn_field_options_bytes(const cn_field_options *options);

#ifdef __cplusplus
}
#endif
#endif
