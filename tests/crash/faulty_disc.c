/* A disc that fills up, or a quota that is used up: loaded before the C library, it lets calls that take room fail.

   Counted are those that write to, lengthen, create, rename or sync what lies in one folder. Of the
   first write that fails half of the bytes are written, as on a disc with a little room left. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static char folder[PATH_MAX];
static long calls, first_failure, last_failure;
static int halved, failure;

/* Let the calls from number `first` to `last`, counted from 1, fail with `error` from now on. */
void fail_calls(const char *below, long first, long last, int error) {
    snprintf(folder, sizeof folder, "%s/", below);
    calls = 0;
    halved = 0;
    first_failure = first;
    last_failure = last;
    failure = error;
}

long count_calls(void) { return calls; }

static int concerns(const char *path) {
    return folder[0] && !strncmp(path, folder, strlen(folder));
}

static int fails(void) {
    calls++;
    if (calls < first_failure || calls > last_failure)
        return 0;
    errno = failure;
    return 1;
}

static int fails_on(int descriptor) {
    char name[64], path[PATH_MAX];
    if (!folder[0])
        return 0;
    snprintf(name, sizeof name, "/proc/self/fd/%d", descriptor);
    ssize_t length = readlink(name, path, sizeof path - 1);
    if (length < 0)
        return 0;
    path[length] = 0;
    return concerns(path) && fails();
}

static int fails_at(const char *name) {
    char path[PATH_MAX];
    if (!folder[0])
        return 0;
    if (name[0] == '/')
        return concerns(name) && fails();
    if (!getcwd(path, sizeof path - strlen(name) - 1))
        return 0;
    strcat(strcat(path, "/"), name);
    return concerns(path) && fails();
}

/* Whether a write that fails is to write half of its bytes; the next one of it writes none. */
static int halves(size_t count) {
    if (halved || count < 2)
        return 0;
    halved = 1;
    calls--;
    return 1;
}

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

#define WRITES(name, parameters, arguments)             \
    ssize_t name parameters {                           \
        if (fails_on(descriptor)) {                     \
            if (!halves(count))                         \
                return -1;                              \
            count /= 2;                                 \
        }                                               \
        return NEXT(name) arguments;                    \
    }

WRITES(write, (int descriptor, const void *bytes, size_t count), (descriptor, bytes, count))
WRITES(pwrite, (int descriptor, const void *bytes, size_t count, off_t place),
       (descriptor, bytes, count, place))
WRITES(pwrite64, (int descriptor, const void *bytes, size_t count, off64_t place),
       (descriptor, bytes, count, place))

int ftruncate64(int descriptor, off64_t length) {
    return fails_on(descriptor) ? -1 : NEXT(ftruncate64)(descriptor, length);
}

int fsync(int descriptor) { return fails_on(descriptor) ? -1 : NEXT(fsync)(descriptor); }

int rename(const char *from, const char *to) { return fails_at(to) ? -1 : NEXT(rename)(from, to); }

int open64(const char *name, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    int mode = flags & O_CREAT ? va_arg(rest, int) : 0;
    va_end(rest);
    if (flags & O_CREAT && access(name, F_OK) && fails_at(name))
        return -1;
    return NEXT(open64)(name, flags, mode);
}
