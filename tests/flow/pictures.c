/* pictures colour IN.exr OUT.exr: the same picture over black, as a PNG shows it: without alpha, by which ocioconvert would divide,
 * and without depth, a channel that it does not take.
 * pictures differ A.png B.png: prints the largest difference of 8-bit codes, over red, green and blue. */
#include "bridge/oiio.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void must(cn_status status)
{
    if (status == CN_OK) return;
    fprintf(stderr, "pictures: %s\n", cn_error_message());
    exit(1);
}

int main(int argc, char **argv)
{
    if (argc != 4) return 2;
    float *a, *b;
    uint32_t w, h, w2, h2;
    must(cn_oiio_read_rgba(argv[2], &a, &w, &h));
    if (strcmp(argv[1], "colour") == 0) {
        for (size_t i = 0; i < (size_t)w * h; i++) a[4 * i + 3] = 1;
        must(cn_oiio_write_exr(argv[3], a, NULL, w, h, NULL));
        free(a);
        return 0;
    }
    must(cn_oiio_read_rgba(argv[3], &b, &w2, &h2));
    double largest = w == w2 && h == h2 ? 0 : 255;
    for (size_t i = 0; i < (size_t)w * h && largest < 255; i++)
        for (size_t c = 0; c < 3; c++) largest = fmax(largest, fabs(round(255.0 * a[4 * i + c]) - round(255.0 * b[4 * i + c])));
    printf("%.0f\n", largest);
    free(a);
    free(b);
    return 0;
}
