/* Calls by which a process changes files below one folder, counted; one of them can be made to
 * fail. Loaded before the C library (LD_PRELOAD), so that HDF5 and other compiled writers are
 * heard too. Linux only. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { FULL = 0, REFUSED = 1, KILLED = 2, TORN = 3 };

static char folder[PATH_MAX];
static size_t length;
static atomic_long count;
static long fault_at = -1;
static int fault_kind;
static char kinds[1 << 20];

/* Count calls below `path` from now on; let number `at` fail, from 0, or none if negative. */
void fault_arm(const char *path, long at, int kind)
{
    strncpy(folder, path, sizeof folder - 1);
    length = strlen(folder);
    atomic_store(&count, 0);
    fault_at = at;
    fault_kind = kind;
}

/* How many calls there were. */
long fault_count(void) { return atomic_load(&count); }

/* What each was: w a write, s a flush, r a renaming, o a new file, m a folder, u a removal. */
const char *fault_kinds(void) { return kinds; }

static int below(const char *path)
{
    return length && !strncmp(path, folder, length) && (path[length] == '/' || !path[length]);
}

static int path_of(int descriptor, char *path)
{
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
    ssize_t n = readlink(link, path, PATH_MAX - 1);
    path[n < 0 ? 0 : n] = 0;
    return n > 0;
}

static int at_below(int descriptor, const char *name)
{
    char path[2 * PATH_MAX];
    if (name[0] == '/')
        return below(name);
    if (descriptor == AT_FDCWD ? !getcwd(path, PATH_MAX) : !path_of(descriptor, path))
        return 0;
    strncat(path, "/", sizeof path - strlen(path) - 1);
    strncat(path, name, sizeof path - strlen(path) - 1);
    return below(path);
}

/* Whether this call fails; errno is set then. Who is to be killed does not come back. */
static int fails(char what)
{
    long now = atomic_fetch_add(&count, 1);
    if (now < (long)sizeof kinds - 1)
        kinds[now] = what;
    if (fault_at < 0 || now < fault_at)
        return 0;
    int adds = what == 'w' || what == 'o' || what == 'm';
    if (fault_kind == FULL && (now == fault_at || adds)) {
        errno = ENOSPC; /* and so does all that adds to the disk from now on */
        return 1;
    }
    if (now != fault_at)
        return 0;
    if (fault_kind == REFUSED) {
        errno = what == 'w' || what == 's' ? EIO : EACCES;
        return 1;
    }
    if (fault_kind == TORN && what == 'w')
        return 2;
    if (fault_kind == KILLED || fault_kind == TORN)
        kill(getpid(), SIGKILL);
    return 0;
}

#define REAL(type, name, ...)                                                                  \
    static type (*real)(__VA_ARGS__);                                                          \
    if (!real)                                                                                 \
        real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name);

static int written(int descriptor)
{
    char path[PATH_MAX];
    return length && descriptor > 2 && path_of(descriptor, path) && below(path) ? fails('w') : 0;
}

#define WRITER(name, parameters, values, half)                                                 \
    ssize_t name parameters                                                                    \
    {                                                                                          \
        static ssize_t(*real) parameters;                                                      \
        if (!real)                                                                             \
            real = (ssize_t(*) parameters)dlsym(RTLD_NEXT, #name);                             \
        int outcome = written(d);                                                              \
        if (outcome == 1)                                                                      \
            return -1;                                                                         \
        if (outcome == 2) {                                                                    \
            real half;                                                                         \
            kill(getpid(), SIGKILL);                                                           \
        }                                                                                      \
        return real values;                                                                    \
    }

WRITER(write, (int d, const void *b, size_t n), (d, b, n), (d, b, n / 2))
WRITER(pwrite, (int d, const void *b, size_t n, off_t o), (d, b, n, o), (d, b, n / 2, o))
WRITER(pwrite64, (int d, const void *b, size_t n, off64_t o), (d, b, n, o), (d, b, n / 2, o))
WRITER(writev, (int d, const struct iovec *v, int n), (d, v, n), (d, v, n / 2))

#define FLUSHER(name)                                                                          \
    int name(int descriptor)                                                                   \
    {                                                                                          \
        REAL(int, name, int)                                                                   \
        char path[PATH_MAX];                                                                   \
        if (length && path_of(descriptor, path) && below(path) && fails('s'))                  \
            return -1;                                                                         \
        return real(descriptor);                                                               \
    }

FLUSHER(fsync)
FLUSHER(fdatasync)

int rename(const char *old, const char *new)
{
    REAL(int, rename, const char *, const char *)
    if (length && at_below(AT_FDCWD, new) && fails('r'))
        return -1;
    return real(old, new);
}

int renameat(int from, const char *old, int to, const char *new)
{
    REAL(int, renameat, int, const char *, int, const char *)
    if (length && at_below(to, new) && fails('r'))
        return -1;
    return real(from, old, to, new);
}

int unlink(const char *path)
{
    REAL(int, unlink, const char *)
    if (length && at_below(AT_FDCWD, path) && fails('u'))
        return -1;
    return real(path);
}

int unlinkat(int at, const char *path, int flags)
{
    REAL(int, unlinkat, int, const char *, int)
    if (length && at_below(at, path) && fails('u'))
        return -1;
    return real(at, path, flags);
}

int rmdir(const char *path)
{
    REAL(int, rmdir, const char *)
    if (length && at_below(AT_FDCWD, path) && fails('u'))
        return -1;
    return real(path);
}

int mkdir(const char *path, mode_t mode)
{
    REAL(int, mkdir, const char *, mode_t)
    if (length && at_below(AT_FDCWD, path) && fails('m'))
        return -1;
    return real(path, mode);
}

int mkdirat(int at, const char *path, mode_t mode)
{
    REAL(int, mkdirat, int, const char *, mode_t)
    if (length && at_below(at, path) && fails('m'))
        return -1;
    return real(at, path, mode);
}

#define OPENER(name)                                                                           \
    int name(const char *path, int flags, ...)                                                 \
    {                                                                                          \
        REAL(int, name, const char *, int, ...)                                                \
        va_list rest;                                                                          \
        va_start(rest, flags);                                                                 \
        mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;                              \
        va_end(rest);                                                                          \
        if (flags & O_CREAT && length && at_below(AT_FDCWD, path) && fails('o'))               \
            return -1;                                                                         \
        return real(path, flags, mode);                                                        \
    }

OPENER(open)
OPENER(open64)

#define OPENER_AT(name)                                                                        \
    int name(int at, const char *path, int flags, ...)                                         \
    {                                                                                          \
        REAL(int, name, int, const char *, int, ...)                                           \
        va_list rest;                                                                          \
        va_start(rest, flags);                                                                 \
        mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;                              \
        va_end(rest);                                                                          \
        if (flags & O_CREAT && length && at_below(at, path) && fails('o'))                     \
            return -1;                                                                         \
        return real(at, path, flags, mode);                                                    \
    }

OPENER_AT(openat)
OPENER_AT(openat64)
