/* A library for LD_PRELOAD that replaces malloc: calls number LG_FAIL_FROM to LG_FAIL_TO find no memory. Only
 * calls from the program and from liegrad's libraries count; other libraries always get memory. Calls that
 * open a stream or a folder count too, as they allocate. LG_FAIL_COUNT: a file that gets the number of
 * calls. */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <link.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The C library's functions under the names that glibc keeps for programs that replace malloc. */
void *__libc_malloc(size_t bytes);
void *__libc_calloc(size_t count, size_t bytes);
void *__libc_realloc(void *memory, size_t bytes);
void *__libc_memalign(size_t alignment, size_t bytes);

enum { MOST = 16 };
static struct { uintptr_t from, to; } code[MOST]; /* of the program and liegrad's libraries */
static int codes;
static _Atomic unsigned long calls;
static unsigned long fail_from, fail_to; /* numbers from 1; 0: no call fails */

static int visit(struct dl_phdr_info *info, size_t size, void *user) {
    (void)size;
    (void)user;
    if (info->dlpi_name[0] != '\0' && strstr(info->dlpi_name, "/libliegrad") == NULL) return 0;
    for (int i = 0; i < info->dlpi_phnum && codes < MOST; i++) {
        const ElfW(Phdr) *part = &info->dlpi_phdr[i];
        if (part->p_type != PT_LOAD || (part->p_flags & PF_X) == 0) continue;
        code[codes].from = info->dlpi_addr + part->p_vaddr;
        code[codes++].to = info->dlpi_addr + part->p_vaddr + part->p_memsz;
    }
    return 0;
}

static unsigned long number(const char *name) {
    const char *value = getenv(name);
    return value != NULL ? strtoul(value, NULL, 10) : 0;
}

__attribute__((constructor)) static void begin(void) {
    fail_from = number("LG_FAIL_FROM");
    fail_to = number("LG_FAIL_TO");
    (void)dl_iterate_phdr(visit, NULL);
}

__attribute__((destructor)) static void end(void) {
    const char *path = getenv("LG_FAIL_COUNT");
    const unsigned long count = calls;
    FILE *stream = path != NULL ? fopen(path, "w") : NULL;
    if (stream == NULL) return;
    (void)fprintf(stream, "%lu\n", count);
    (void)fclose(stream);
}

static int fails(const void *caller) {
    const uintptr_t at = (uintptr_t)caller;
    for (int i = 0; i < codes; i++) {
        if (at < code[i].from || at >= code[i].to) continue;
        const unsigned long call = ++calls;
        if (call < fail_from || call > fail_to) return 0;
        errno = ENOMEM;
        return 1;
    }
    return 0;
}

#define HERE __builtin_return_address(0)

void *malloc(size_t bytes) {
    return fails(HERE) ? NULL : __libc_malloc(bytes);
}

void *calloc(size_t count, size_t bytes) {
    return fails(HERE) ? NULL : __libc_calloc(count, bytes);
}

void *realloc(void *memory, size_t bytes) {
    return fails(HERE) ? NULL : __libc_realloc(memory, bytes);
}

void *aligned_alloc(size_t alignment, size_t bytes) {
    return fails(HERE) ? NULL : __libc_memalign(alignment, bytes);
}

int posix_memalign(void **out, size_t alignment, size_t bytes) {
    void *memory = fails(HERE) ? NULL : __libc_memalign(alignment, bytes);
    if (memory == NULL) return ENOMEM;
    *out = memory;
    return 0;
}

/* Defines a function that opens something and allocates memory for it. */
#define OPENS(type, function, parameters, values)                                                            \
    type *function parameters {                                                                              \
        if (fails(HERE)) return NULL;                                                                        \
        type *(*next)parameters;                                                                             \
        *(void **)&next = dlsym(RTLD_NEXT, #function);                                                       \
        return next values;                                                                                  \
    }
OPENS(FILE, fopen, (const char *path, const char *mode), (path, mode))
OPENS(FILE, fdopen, (int fd, const char *mode), (fd, mode))
OPENS(FILE, open_memstream, (char **data, size_t *length), (data, length))
OPENS(DIR, opendir, (const char *path), (path))
