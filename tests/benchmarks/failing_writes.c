// Lets the n-th call that changes a folder fail: loaded before the C library, so that nothing can pass it by.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

static char folder[4096];
static atomic_long calls;
static long first = -1, many;
static int kind, slow_ms;
static double until_s, for_s;
static char met[4400];

static double now_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

// From the call number `at` on, `count` calls fail with `error`, and all others for `seconds`.
void arm(const char *path, long at, long count, double seconds, int error, int milliseconds) {
    strncpy(folder, path, sizeof folder - 1);
    atomic_store(&calls, 0);
    first = at, many = count, for_s = seconds, until_s = 0, kind = error, slow_ms = milliseconds;
    met[0] = 0;
}

long counted(void) { return atomic_load(&calls); }
const char *what_failed(void) { return met; }

static int fails(const char *call, const char *path) {
    if (!folder[0] || !path || !strstr(path, folder)) return 0;
    if (slow_ms) usleep(1000 * slow_ms);
    long number = atomic_fetch_add(&calls, 1);
    int hit = first >= 0 && ((number >= first && number < first + many) || now_s() < until_s);
    if (number == first) {
        until_s = now_s() + for_s;
        snprintf(met, sizeof met, "%s %s", call, path + strlen(folder));
    }
    if (hit) errno = kind;
    return hit;
}

static int fails_on(const char *call, int descriptor) {
    char link[64], path[4096];
    if (!folder[0]) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length <= 0) return 0;
    path[length] = 0;
    return fails(call, path);
}

#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))
#define BY_PATH(type, name, params, args, path) \
    type name params { static __typeof__(&name) real; if (!real) real = REAL(name); if (fails(#name, path)) return -1; return real args; }
#define BY_FILE(type, name, params, args) \
    type name params { static __typeof__(&name) real; if (!real) real = REAL(name); if (fails_on(#name, fd)) return -1; return real args; }
#define OPENING(name, params, args, path) \
    int name params { static __typeof__(&name) real; if (!real) real = REAL(name); mode_t mode = 0; \
        if (flags & (O_CREAT | O_TMPFILE)) { va_list more; va_start(more, flags); mode = va_arg(more, mode_t); va_end(more); } \
        if ((flags & (O_WRONLY | O_RDWR | O_CREAT)) && fails(#name, path)) return -1; return real args; }

OPENING(open, (const char *path, int flags, ...), (path, flags, mode), path)
OPENING(open64, (const char *path, int flags, ...), (path, flags, mode), path)
OPENING(openat, (int at, const char *path, int flags, ...), (at, path, flags, mode), path)
OPENING(openat64, (int at, const char *path, int flags, ...), (at, path, flags, mode), path)
BY_FILE(ssize_t, write, (int fd, const void *data, size_t size), (fd, data, size))
BY_FILE(ssize_t, pwrite, (int fd, const void *data, size_t size, off_t place), (fd, data, size, place))
BY_FILE(ssize_t, pwrite64, (int fd, const void *data, size_t size, off64_t place), (fd, data, size, place))
BY_FILE(ssize_t, writev, (int fd, const struct iovec *parts, int count), (fd, parts, count))
BY_FILE(ssize_t, pwritev, (int fd, const struct iovec *parts, int count, off_t place), (fd, parts, count, place))
BY_FILE(ssize_t, pwritev2, (int fd, const struct iovec *parts, int count, off_t place, int flags), (fd, parts, count, place, flags))
BY_FILE(ssize_t, pwritev64v2, (int fd, const struct iovec *parts, int count, off64_t place, int flags), (fd, parts, count, place, flags))
BY_FILE(int, fsync, (int fd), (fd))
BY_FILE(int, fdatasync, (int fd), (fd))
BY_FILE(int, ftruncate, (int fd, off_t size), (fd, size))
BY_FILE(int, ftruncate64, (int fd, off64_t size), (fd, size))
BY_PATH(int, mkdir, (const char *path, mode_t mode), (path, mode), path)
BY_PATH(int, mkdirat, (int at, const char *path, mode_t mode), (at, path, mode), path)
BY_PATH(int, rename, (const char *from, const char *to), (from, to), to)
BY_PATH(int, renameat, (int a, const char *from, int b, const char *to), (a, from, b, to), to)
BY_PATH(int, link, (const char *from, const char *to), (from, to), to)
BY_PATH(int, linkat, (int a, const char *from, int b, const char *to, int flags), (a, from, b, to, flags), to)
BY_PATH(int, unlink, (const char *path), (path), path)
BY_PATH(int, unlinkat, (int at, const char *path, int flags), (at, path, flags), path)
BY_PATH(int, rmdir, (const char *path), (path), path)
