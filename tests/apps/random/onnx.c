/* Compares what onnxruntime computes from ONNX files with the program. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apps/random/exports.h"
#include "liegrad/program.h"

enum { MOST_NUMBERS = 200000 };

static FILE *open_numbers(const model *m, const char *port, const char *mode) {
    char path[FOLDER + 64];
    (void)snprintf(path, sizeof path, "%s/%s.bin", m->folder, port);
    FILE *file = fopen(path, mode);
    if (file == NULL) stop("no %s", path);
    return file;
}

static void write_inputs(const model *m, const truth *t, const lg_port *in) {
    for (size_t i = 0; i < t->inputs; i++) {
        FILE *file = open_numbers(m, in[i].name, "wb");
        if (fwrite(input_of(t, i), sizeof(double), t->in_count[i], file) != t->in_count[i] ||
            fclose(file) != 0)
            stop("no inputs in %s", m->folder);
    }
}

/* onnxruntime approximates sigmoid and tanh in single precision: absolute errors of some 1e-7. */
#define APPROXIMATE 1e-6

static bool is_near(const truth *t, size_t o, const double *got) {
    const double *want = lg_node_at(t->tape, t->out[o])->value;
    double largest = 1.0, off = 0.0;
    for (size_t i = 0; i < t->out_count[o]; i++) {
        largest = fmax(largest, fabs(want[i]));
        if (!(fabs(got[i] - want[i]) <= off)) off = fabs(got[i] - want[i]);
    }
    return off <= APPROXIMATE * largest;
}

static bool compare_output(const model *m, const truth *t, size_t o, const char *port, lg_dtype dtype,
                           finding *f) {
    const size_t count = t->out_count[o];
    double *numbers = room(count, sizeof *numbers);
    void *own = room(count, sizeof *numbers);
    char sentence[256];
    FILE *file = open_numbers(m, port, "rb");
    const bool whole = fread(numbers, sizeof *numbers, count, file) == count;
    (void)fclose(file);
    lg_kernels_for(dtype)->convert_in(count, numbers, own);
    const bool good =
        whole ? explained(t, o, dtype, own, sentence, sizeof sentence) ||
                    (dtype == LG_F32 && is_near(t, o, numbers)) ||
                    found(f, false, "%s in %s: %s", port, dtype == LG_F64 ? "f64" : "f32", sentence)
              : found(f, false, "%s has too few numbers", port);
    free(own);
    free(numbers);
    return good;
}

static bool compare(const model *m, const truth *t, size_t function, finding *f) {
    char answer[400] = "";
    size_t count;
    const lg_port *out = lg_program_outputs(m->program, function, &count);
    write_inputs(m, t, lg_program_inputs(m->program, function, &count));
    if (!ask_peer(PEER_ONNX, m, t->rows, answer, sizeof answer)) return true;
    const bool single = strcmp(answer, "f32") == 0;
    bool good = single || strcmp(answer, "f64") == 0 || found(f, false, "%s", answer);
    for (size_t o = 0; good && o < t->outputs; o++)
        good = compare_output(m, t, o, out[o].name, single ? LG_F32 : LG_F64, f);
    return good;
}

static bool check(model *m, finding *f) {
    lg_tape *tape = NULL;
    lg_rng rng;
    truth t;
    size_t rows = m->r->rows;
    const size_t function = function_named(m, m->function);
    if (lg_tape_create(NULL, NULL, &tape) != LG_OK) stop("no memory");
    lg_rng_seed(&rng, m->r->number, 600);
    while (rows > 1 && numbers_of(m->program, function, rows) > MOST_NUMBERS) rows /= 2;
    find_truth(tape, m->program, function, rows, &rng, &t);
    tallied.functions++;
    tallied.unfit += !t.finite;
    const bool good = !t.finite || compare(m, &t, function, f);
    lg_tape_destroy(tape);
    return good;
}

const target target_onnx = {.name = "onnx", .check = check};
