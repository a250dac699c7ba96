/* Compares recordings as C. The functions of many recordings are compiled as one file, for one row each. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "autodiff/compiled.h"
#include "autodiff/random/random.h"

enum { POINTS = 3 };

/* The ways to compile: both types, straight code and loops, both compilers; the second compiler only if it is
 * installed. */
static const struct {
    const char *compiler;
    lg_dtype dtype;
    bool compact;
} ways[] = {{"gcc", LG_F64, false}, {"clang", LG_F32, true}, {"gcc", LG_F32, false}, {"clang", LG_F64, true}};

/* Undefined behaviour ends the program with a signal (main.c). */
#define CHECKED "-O1 -fsanitize=undefined,float-cast-overflow -fno-sanitize-recover=all"
bool compiled_checked;

static bool has(const char *compiler) {
    char command[64];
    (void)snprintf(command, sizeof command, "command -v %s >/dev/null", compiler);
    return system(command) == 0;
}

/* Whether output `wanted`, requested alone in the work memory as the first run left it, has the same bits. */
static bool same_alone(const compiled *c, shim run, const truth *t, void *const *in, void *const *out,
                       void *work, finding *f) {
    const size_t wanted = (size_t)(t->seed % t->outputs),
                 bytes = t->out_count[wanted] * (c->single ? sizeof(float) : sizeof(double));
    void *other[LG_PROGRAM_MAX_PORTS] = {NULL};
    other[wanted] = room(bytes, 1);
    run((const void *const *)in, other, work);
    const bool same = memcmp(other[wanted], out[wanted], bytes) == 0;
    free(other[wanted]);
    return same || found(f, false, "output %zu alone has other bits", wanted);
}

static bool check_point(const compiled *c, shim run, const truth *t, finding *f) {
    const lg_dtype dtype = c->single ? LG_F32 : LG_F64;
    void *in[LG_PROGRAM_MAX_PORTS], *out[LG_PROGRAM_MAX_PORTS],
        *work = room(c->source->work_size, sizeof(double));
    char sentence[256];
    bool good = true;
    memset(work, 0xff, c->source->work_size * sizeof(double)); /* NaN */
    for (size_t i = 0; i < t->inputs; i++) {
        in[i] = room(t->in_count[i], sizeof(double));
        lg_kernels_for(dtype)->convert_in(t->in_count[i], lg_node_at(t->tape, t->in[i])->value, in[i]);
    }
    for (size_t j = 0; j < t->outputs; j++) out[j] = room(t->out_count[j], sizeof(double));
    run((const void *const *)(void *const *)in, out, work);
    for (size_t j = 0; good && j < t->outputs; j++)
        good = explained(t, j, dtype, out[j], sentence, sizeof sentence) || found(f, false, "%s", sentence);
    if (good) good = same_alone(c, run, t, in, out, work, f);
    for (size_t i = 0; i < t->inputs; i++) free(in[i]);
    for (size_t j = 0; j < t->outputs; j++) free(out[j]);
    free(work);
    return good;
}

static bool check_function(const compiled *c, lg_tape *tape, const lg_program *program, size_t function,
                           uint64_t number, size_t at, finding *f) {
    const char *name = lg_program_function_name(program, function);
    const shim run = shim_of(c, name);
    finding own;
    lg_rng rng;
    lg_rng_seed(&rng, number, 200 + at);
    counted.functions++;
    for (int p = 0; p < POINTS; p++) {
        truth t;
        find_truth(tape, program, function, 1, &rng, &t);
        if (!t.finite)
            counted.unfit++;
        else if (!check_point(c, run, &t, &own))
            return found(f, false, "%s in C, %s: %.300s", name, c->single ? "f32" : "f64", own.sentence);
    }
    return true;
}

typedef struct part {
    size_t number[MOST_ALL], count;
} part;

static bool check_file(const compiled *c, const lg_program *program, const recording *r, const part *parts,
                       size_t count, finding *f, size_t *failed) {
    lg_tape *tape = NULL;
    bool good = true;
    if (lg_tape_create(NULL, NULL, &tape) != LG_OK) stop("no memory");
    for (size_t i = 0; good && i < count; i++)
        for (size_t k = 0; good && k < parts[i].count; k++) {
            looked_at = r[i].number;
            good = check_function(c, tape, program, parts[i].number[k], r[i].number, k, f);
            *failed = i;
        }
    lg_tape_destroy(tape);
    return good;
}

/* The way to compile is chosen by the recordings' number divided by 100. So a single recording is compiled
 * the same way as in its file. A program with constants that are not finite, such as sqrt'(0), has no C: then
 * fewer recordings are taken, at last none but the one that has them. */
bool check_compiled(const recording *r, size_t *taken, finding *out, size_t *failed) {
    part *parts = room(*taken, sizeof *parts);
    size_t count = 0;
    lg_program *program = empty_program();
    lg_error error = {.message = ""};
    compiled c = {.handle = NULL};
    bool good = true;
    *failed = 0;
    while (good && count < *taken && lg_program_functions(program) + MOST_ALL <= LG_PROGRAM_MAX_FUNCTIONS) {
        good = add_recording(program, &r[count], parts[count].number, &parts[count].count, &error) ||
               found(out, true, "the recording becomes no program: %.300s", error.message);
        *failed = count++;
    }
    const size_t way = (size_t)(r[0].number / 100 % (sizeof ways / sizeof *ways));
    const char *compiler = compiled_checked || !has(ways[way].compiler) ? "gcc" : ways[way].compiler;
    const char *flags = compiled_checked ? CHECKED : "-O2";
    if (good && !compile_program(&c, program, compiler, flags, ways[way].dtype, ways[way].compact))
        good = c.unfit || found(out, true, "no compiled C: %.400s", c.why);
    const bool fewer = good && c.unfit && count > 1;
    if (good && !c.unfit)
        good = check_file(&c, program, r, parts, count, out, failed) && discard_compiled(&c);
    counted.recordings += fewer ? 0 : count;
    counted.sources += !c.unfit;
    counted.refused += c.unfit && !fewer;
    lg_program_destroy(program);
    free(parts);
    *taken = fewer ? count / 2 : count;
    return fewer ? check_compiled(r, taken, out, failed) : good;
}
