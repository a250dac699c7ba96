/* Writes a program as C, compiles it and loads its functions. */
#ifndef LG_COMPILED_H
#define LG_COMPILED_H

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "liegrad/program.h"

#define WARNINGS "-Wall -Wextra -Wconversion -Wdouble-promotion -Wshadow -pedantic -Werror"

/* Whether the tests can compile and run C: not in a build for another machine. */
static inline bool has_compiler(void) {
#ifdef LG_CROSS
    return false;
#else
    return system("command -v gcc >/dev/null") == 0;
#endif
}

/* A function of the compiled program, called with arrays of pointers: shim_<function>. */
typedef void (*shim)(const void *const *in, void *const *out, void *work);

typedef struct compiled {
    char folder[64];
    void *handle;
    lg_c_source *source;
    bool single, unfit; /* unfit: refused, because it has numbers that are not finite */
    char why[1280];     /* what failed */
} compiled;

static inline bool write_file(const compiled *c, const char *name, const char *const *parts, size_t count) {
    char path[128];
    (void)snprintf(path, sizeof path, "%s/%s", c->folder, name);
    FILE *file = fopen(path, "w");
    bool written = file != NULL;
    for (size_t i = 0; written && i < count; i++) written = fputs(parts[i], file) >= 0;
    return file != NULL && fclose(file) == 0 && written;
}

static inline bool write_shims(const compiled *c, const lg_program *program) {
    char path[128];
    (void)snprintf(path, sizeof path, "%s/shims.c", c->folder);
    FILE *file = fopen(path, "w");
    if (file == NULL) return false;
    (void)fprintf(file, "#include \"p.h\"\n");
    for (size_t i = 0; i < c->source->functions; i++) {
        size_t ins = 0, outs = 0;
        const char *name = lg_program_function_name(program, c->source->function[i]);
        (void)lg_program_inputs(program, c->source->function[i], &ins);
        (void)lg_program_outputs(program, c->source->function[i], &outs);
        (void)fprintf(file,
                      "void shim_%s(const void *const *in, void *const *out, void *work);\n"
                      "void shim_%s(const void *const *in, void *const *out, void *work) {\n    p_%s(",
                      name, name, name);
        for (size_t k = 0; k < ins; k++) (void)fprintf(file, "(const p_real *)in[%zu], ", k);
        for (size_t k = 0; k < outs; k++) (void)fprintf(file, "(p_real *)out[%zu], ", k);
        (void)fprintf(file, "(p_real *)work);\n}\n");
    }
    return fclose(file) == 0;
}

static inline bool write_source(compiled *c, const lg_program *program, lg_dtype dtype, bool compact) {
    lg_c_options options;
    lg_error error;
    lg_c_options_init(&options);
    options.name = "p";
    options.dtype = dtype;
    options.compact = compact;
    const lg_status status = lg_program_write_c(program, &options, &c->source, &error);
    if (status != LG_OK) {
        c->unfit = status == LG_NOT_FINITE;
        (void)snprintf(c->why, sizeof c->why, "%s", error.message);
        return false;
    }
    const lg_c_source *s = c->source;
    (void)snprintf(c->why, sizeof c->why, "no file in %s", c->folder);
    return mkdtemp(c->folder) != NULL && write_shims(c, program) &&
           write_file(c, "p.h", (const char *const[]){s->sizes, s->declarations}, 2) &&
           write_file(c, "p.c",
                      (const char *const[]){"#include \"p.h\"\n#include <stddef.h>\n", s->arrays, s->code},
                      3) &&
           write_file(c, "p_weights.c", (const char *const[]){"#include \"p.h\"\n", s->arrays, s->weights},
                      3);
}

/* Returns false if a step failed; c->why says which. The folder is then kept. */
static inline bool compile_program(compiled *c, const lg_program *program, const char *compiler,
                                   const char *flags, lg_dtype dtype, bool compact) {
    char path[128];
    *c = (compiled){.folder = "/tmp/liegrad-program-c-XXXXXX", .single = dtype == LG_F32};
    if (!write_source(c, program, dtype, compact)) return false;
    (void)snprintf(c->why, sizeof c->why,
                   "cd %s && %s %s -std=c99 -Wstrict-prototypes -Wmissing-prototypes " WARNINGS
                   " -fPIC -shared p.c p_weights.c shims.c -lm -o lib.so 2>&1",
                   c->folder, compiler, flags);
    if (system(c->why) != 0) return false;
    (void)snprintf(path, sizeof path, "%s/lib.so", c->folder);
    c->handle = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (c->handle == NULL) (void)snprintf(c->why, sizeof c->why, "%s", dlerror());
    return c->handle != NULL;
}

static inline shim shim_of(const compiled *c, const char *function) {
    char name[128];
    shim found;
    (void)snprintf(name, sizeof name, "shim_%s", function);
    *(void **)&found = dlsym(c->handle, name);
    return found;
}

/* Returns false if the folder cannot be removed. */
static inline bool discard_compiled(compiled *c) {
    char command[128];
    if (c->handle != NULL) (void)dlclose(c->handle);
    lg_c_source_destroy(c->source);
    (void)snprintf(command, sizeof command, "rm -rf -- '%.63s'", c->folder);
    return system(command) == 0;
}

#endif
