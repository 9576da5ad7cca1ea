/* compare_pictures A B: how two pictures of one size differ, in values of 0 to 1. Prints the PSNR in dB ("inf": not at
 * all) and the largest difference. */
#include "bridge/oiio.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    float *pixels[2] = { NULL, NULL };
    uint32_t width[2], height[2];
    double squares = 0, most = 0;
    for (int i = 0; i < 2; i++)
        if (argc != 3 || cn_oiio_read_rgba(argv[i + 1], &pixels[i], &width[i], &height[i]) != CN_OK) {
            fprintf(stderr, "compare_pictures: %s\n", argc == 3 ? cn_error_message() : "give two pictures");
            return 1;
        }
    if (width[0] != width[1] || height[0] != height[1]) {
        fprintf(stderr, "compare_pictures: %u x %u and %u x %u pixels\n", width[0], height[0], width[1], height[1]);
        return 1;
    }
    const size_t n = (size_t)width[0] * height[0] * 4;
    for (size_t i = 0; i < n; i++) {
        const double d = fabs((double)pixels[0][i] - (double)pixels[1][i]);
        squares += d * d / (double)n;
        most = fmax(most, d);
    }
    printf("%.1f %.4f\n", -10 * log10(squares), most);
    free(pixels[0]);
    free(pixels[1]);
    return 0;
}
