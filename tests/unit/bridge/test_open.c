/* The first photos of a process, opened by all its threads at once. OpenImageIO 2.4.7 fills static tables in the first
 * call of ImageInput::open, without a lock; exiv2's XMP parser wants a lock from who uses it. Only a new process has
 * done neither, so each trial is a process of its own. */
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <setjmp.h>
#include <cmocka.h>

#include "segment.h"

#include "base/file.h"
#include "bridge/exiv2.h"
#include "bridge/oiio.h"

#include <lcms2.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

enum { PROCESSES = 300, THREADS = 4 };
static char path[] = "/tmp/conurb-open-XXXXXX.jpg";
static pthread_barrier_t all_ready;
static bool exiv2_first; /* which library is tried */

static void *open_photo(void *user)
{
    bool *good = user;
    cn_oiio_info info;
    cn_exif exif;
    pthread_barrier_wait(&all_ready);
    *good = exiv2_first ? cn_exiv2_read(path, &exif) == CN_OK && exif.has_latlon
                        : cn_oiio_read_info(path, &info) == CN_OK && info.width == 16;
    return NULL;
}

static int open_at_once(void)
{
    pthread_t threads[THREADS];
    bool good[THREADS] = { false }, all = true;
    alarm(60); /* threads that spoil each other's tables may also hang */
    if (pthread_barrier_init(&all_ready, NULL, THREADS) != 0) return 2;
    for (int i = 0; i < THREADS; i++)
        if (pthread_create(&threads[i], NULL, open_photo, &good[i]) != 0) return 2;
    for (int i = 0; i < THREADS; i++) {
        pthread_join(threads[i], NULL);
        all = all && good[i];
    }
    return all ? 0 : 1;
}

static int write_photo(void)
{
    static const float grey[16 * 16 * 3];
    static const double place[3] = { 46, 50, 33 }, shutter = 0.004;
    const cn_oiio_attribute attributes[] = {
        { "GPS:Latitude", NULL, place, 3 },    { "GPS:Longitude", NULL, place, 3 },
        { "ExposureTime", NULL, &shutter, 1 }, { "Exif:DateTimeOriginal", "2016:06:23 16:31:59", NULL, 0 },
        { "Make", "Acme", NULL, 0 },           { NULL, NULL, NULL, 0 }
    };
    return cn_oiio_write_jpeg(path, grey, 16, 16, attributes) == CN_OK ? 0 : 1;
}

/* The exit status of work() in a new process. A signal counts as 128 and its number. */
static int in_a_process(int (*work)(void))
{
    fflush(NULL);
    const pid_t pid = fork();
    if (pid == 0) _exit(work());
    int state = 0;
    assert_true(pid > 0 && waitpid(pid, &state, 0) == pid);
    return WIFEXITED(state) ? WEXITSTATUS(state) : 128 + WTERMSIG(state);
}

static const char PACKET[] =
    "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">"
    "<rdf:Description rdf:about=\"\" xmlns:drone-dji=\"http://www.dji.com/drone-dji/1.0/\" "
    "drone-dji:RelativeAltitude=\"+40.10\" drone-dji:GimbalYawDegree=\"-12.30\"/></rdf:RDF></x:xmpmeta>";

static int set_up(void **state)
{
    (void)state;
    const int fd = mkstemps(path, 4);
    assert_true(fd >= 0 && close(fd) == 0);
    assert_int_equal(in_a_process(write_photo), 0);
    cmsHPROFILE srgb = cmsCreate_sRGBProfile();
    cmsUInt32Number size = 0;
    assert_true(srgb && cmsSaveProfileToMem(srgb, NULL, &size));
    void *bytes = malloc(size);
    assert_true(bytes && cmsSaveProfileToMem(srgb, bytes, &size) && cmsCloseProfile(srgb));
    segment_profile(path, bytes, size);
    segment_xmp(path, PACKET);
    free(bytes);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    return unlink(path);
}

static void try_processes(void)
{
    int failed = 0, last = 0;
    for (int i = 0; i < PROCESSES; i++) {
        const int code = in_a_process(open_at_once);
        if (code) failed++, last = code;
        if (code == 128 + SIGALRM) break;
    }
    if (failed) print_message("%d of %d processes failed, the last with status %d\n", failed, PROCESSES, last);
    assert_int_equal(failed, 0);
}

static void first_photos_open_in_all_threads(void **state)
{
    (void)state;
    exiv2_first = false;
    try_processes();
}

static void first_exif_is_read_in_all_threads(void **state)
{
    (void)state;
    exiv2_first = true;
    try_processes();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(first_photos_open_in_all_threads),
        cmocka_unit_test(first_exif_is_read_in_all_threads),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
