/* pictures colour IN.exr OUT.exr: the same picture over black, as a PNG shows it: without alpha, by which ocioconvert
 * would divide, and without depth, a channel that it does not take. pictures differ A.png B.png: prints the largest
 * difference of 8-bit codes, over red, green and blue. pictures psnr A.png B.png: prints their PSNR in dB. */
#include "bridge/oiio.h"
#include "conurb/measure.h"

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

static double largest_difference(const float *a, const float *b, size_t n)
{
    double largest = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t c = 0; c < 3; c++)
            largest = fmax(largest, fabs(round(255.0 * a[4 * i + c]) - round(255.0 * b[4 * i + c])));
    return largest;
}

static double psnr(float *a, float *b, size_t n)
{
    for (size_t i = 0; i < n; i++)
        for (size_t c = 0; c < 3; c++) {
            a[3 * i + c] = a[4 * i + c];
            b[3 * i + c] = b[4 * i + c];
        }
    return cn_measure_psnr(a, b, NULL, n);
}

int main(int argc, char **argv)
{
    if (argc != 4) return 2;
    float *a, *b;
    uint32_t w, h, w2, h2;
    must(cn_oiio_read_rgba(argv[2], &a, &w, &h));
    if (strcmp(argv[1], "colour") == 0) {
        for (size_t i = 0; i < (size_t)w * h; i++)
            a[4 * i + 3] = 1;
        must(cn_oiio_write_exr(argv[3], a, NULL, w, h, NULL));
        free(a);
        return 0;
    }
    must(cn_oiio_read_rgba(argv[3], &b, &w2, &h2));
    const bool same_size = w == w2 && h == h2;
    const size_t n = (size_t)w * h;
    if (strcmp(argv[1], "psnr") == 0)
        printf("%.2f\n", same_size ? psnr(a, b, n) : 0);
    else
        printf("%.0f\n", same_size ? largest_difference(a, b, n) : 255);
    free(a);
    free(b);
    return 0;
}
