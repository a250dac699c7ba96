/* A plain training loop that uses lg_program_record. */
#include "programs.h"

#include <stdlib.h>
#include <string.h>

#include <liegrad/core.h>
#include <liegrad/fit.h>

enum { PORTS = 8, PARAMETERS = 16 };

typedef struct loop {
    const lg_program *program;
    const training *how;
    lg_tape *tape;
    size_t loss, parameters;
    double *theta[PARAMETERS], *gradient[PARAMETERS], *m[PARAMETERS], *v[PARAMETERS];
    lg_var on_tape[PARAMETERS];
} loop;

/* Records the loss of these samples on the tape. */
static lg_var record(loop *l, const uint32_t *samples, uint32_t count) {
    size_t inputs;
    const lg_port *port = lg_program_inputs(l->program, l->loss, &inputs);
    lg_var x[PORTS], loss = LG_NONE;
    lg_tape_reset(l->tape);
    for (size_t i = 0; i < inputs; i++) {
        const size_t row = lg_shape_count(port[i].shape);
        void *values;
        x[i] = lg_input_buffer(l->tape, lg_port_shape(&port[i], count), &values);
        if (lg_is_none(x[i])) return LG_NONE;
        for (uint32_t r = 0; r < count; r++)
            memcpy((double *)values + r * row, l->how->columns[i] + samples[r] * row, row * sizeof(double));
    }
    for (size_t j = 0; j < l->parameters; j++)
        l->on_tape[j] = lg_parameter(l->tape, lg_program_parameter(l->program, j).shape, l->theta[j]);
    (void)lg_program_record(l->tape, l->program, l->loss, l->on_tape, x, &loss);
    return loss;
}

static double over_all(loop *l, const uint32_t *order) {
    double value = 0;
    (void)lg_read(l->tape, record(l, order, (uint32_t)l->how->samples), 1, &value);
    return value;
}

static lg_status run(loop *l, uint32_t *order, double *first, double *last) {
    const size_t per_epoch = l->how->samples / l->how->batch;
    lg_adam_options adam;
    lg_adam_options_init(&adam);
    lg_rng rng;
    lg_rng_seed(&rng, 7, 0);
    adam.lr = l->how->rate;
    if (first != NULL) *first = over_all(l, order);
    for (size_t n = 0; n < l->how->steps && lg_tape_status(l->tape) == LG_OK; n++) {
        const double left = 1 - (double)n / (double)l->how->steps;
        if (n % per_epoch == 0) lg_rng_shuffle(&rng, order, l->how->samples);
        const lg_var loss = record(l, order + n % per_epoch * l->how->batch, l->how->batch);
        if (lg_backward_set(l->tape, loss, l->on_tape, l->parameters, (void *const *)l->gradient) != LG_OK)
            break;
        for (size_t j = 0; j < l->parameters; j++)
            lg_adam_step(&adam, LG_F64, n + 1, left, 1, l->gradient[j],
                         lg_shape_count(lg_program_parameter(l->program, j).shape), l->m[j], l->v[j],
                         l->theta[j]);
    }
    if (last != NULL) *last = over_all(l, order);
    return lg_tape_status(l->tape);
}

lg_status train(lg_program *program, const training *how, double *first, double *last, lg_error *error) {
    loop l = {.program = program, .how = how, .parameters = lg_program_parameters(program)};
    uint32_t *order = calloc(how->samples, sizeof *order);
    lg_status status = lg_program_find(program, "loss", &l.loss, NULL);
    bool memory = order != NULL && l.parameters <= PARAMETERS;
    for (size_t j = 0; memory && j < l.parameters; j++) {
        const lg_parameter_spec p = lg_program_parameter(program, j);
        const size_t count = lg_shape_count(p.shape);
        double **arrays[] = {&l.theta[j], &l.gradient[j], &l.m[j], &l.v[j]};
        for (int i = 0; i < 4; i++) memory &= (*arrays[i] = calloc(count, sizeof(double))) != NULL;
        if (memory) memcpy(l.theta[j], p.values, count * sizeof *p.values);
    }
    for (size_t i = 0; memory && i < how->samples; i++) order[i] = (uint32_t)i;
    if (status == LG_OK) status = memory ? lg_tape_create(NULL, NULL, &l.tape) : LG_OUT_OF_MEMORY;
    if (status == LG_OK) status = run(&l, order, first, last);
    for (size_t j = 0; status == LG_OK && j < l.parameters; j++)
        status = lg_program_set_parameter(program, j, l.theta[j]);
    if (status != LG_OK && error != NULL) {
        *error = (lg_error){.status = status};
        if (l.tape != NULL) (void)strncpy(error->message, lg_tape_message(l.tape), sizeof error->message - 1);
    }
    for (size_t j = 0; j < l.parameters && j < PARAMETERS; j++) {
        free(l.theta[j]);
        free(l.gradient[j]);
        free(l.m[j]);
        free(l.v[j]);
    }
    lg_tape_destroy(l.tape);
    free(order);
    return status;
}
