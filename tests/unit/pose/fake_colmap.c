#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <cmocka.h>

#include "fake_colmap.h"

#include <math.h>
#include <stdio.h>
#include <sys/stat.h>

void fake_colmap_photos(cn_photo *photos, int n, uint32_t width, uint32_t height)
{
    static char names[26][8];
    assert_in_range(n, 1, 26);
    for (int i = 0; i < n; i++) {
        snprintf(names[i], sizeof names[i], "%c.jpg", 'a' + i);
        photos[i] = (cn_photo){ .name = names[i],
                                .width = width,
                                .height = height,
                                .orientation = 1,
                                .camera = "",
                                .focal_mm = NAN,
                                .focal_35mm = NAN,
                                .hash = (uint64_t)i };
    }
}

void fake_colmap_write(const char *program, const char *format, ...)
{
    va_list arguments;
    FILE *file = fopen(program, "w");
    assert_non_null(file);
    fputs("#!/bin/sh\n[ \"$2\" = -h ] && { [ -e \"$0.help\" ] && cat \"$0.help\"; exit 0; }\n", file);
    va_start(arguments, format);
    vfprintf(file, format, arguments);
    va_end(arguments);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(chmod(program, 0755), 0);
}
