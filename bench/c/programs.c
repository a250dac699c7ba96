/* programs MODEL.h5 FOLDER/p.h5 SCHEME ROUNDS: a learned Hamiltonian in four ways, in turn: the library's
 * functions written by hand, its program (a plan), today's C of lg-export (model.h), the program's C (p.h).
 * Value, value and gradient, field with an input, step of 0.01. */
#include "liegrad/hamiltonian.h"
#include "liegrad/io.h"
#include "liegrad/model.h"
#include "liegrad/program.h"
#include "liegrad/random.h"
#include "model.h"
#include "p.h"
#include "timing.h"

enum { INPUTS = 16, D = model_INPUTS, MOST = 2 * D + 1, FUNCTIONS = 4 };

static struct {
    lg_model_file file;
    const lg_model *model;
    lg_stepper *stepper;
    lg_plan *plan[FUNCTIONS];
    void *work, *plan_work;
    double x[INPUTS][D], u[INPUTS][D], h;
    double hand[MOST], program[MOST], today[MOST], written[MOST];
    _Alignas(64) model_real model_room[model_WORK_SIZE];
    _Alignas(64) p_real room[p_WORK_SIZE + 1];
} all = {.h = 0.01};

/* ---- value, gradient, field, step ---- */

static void hand_value(size_t i) {
    lg_model_eval(all.model, all.x[i], all.hand, all.work);
}
static void hand_gradient(size_t i) {
    lg_model_jacobian(all.model, all.x[i], all.hand, all.hand + 1, all.work);
}
static void hand_field(size_t i) {
    (void)lg_model_field(all.model, all.x[i], all.u[i], all.hand, all.work);
}
static void hand_step(size_t i) {
    lg_stepper_reset(all.stepper);
    (void)lg_step(all.stepper, 0, all.h, all.x[i], all.u[i], all.hand);
}

static void plan_value(size_t i) {
    lg_plan_eval(all.plan[0], (const void *[]){all.x[i]}, (void *[]){all.program}, all.plan_work);
}
static void plan_gradient(size_t i) {
    lg_plan_eval(all.plan[1], (const void *[]){all.x[i]}, (void *[]){all.program, all.program + 1},
                 all.plan_work);
}
static void plan_field(size_t i) {
    lg_plan_eval(all.plan[2], (const void *[]){all.x[i], all.u[i]}, (void *[]){all.program}, all.plan_work);
}
static void plan_step(size_t i) {
    lg_plan_eval(all.plan[3], (const void *[]){all.x[i], all.u[i], &all.h}, (void *[]){all.program},
                 all.plan_work);
}

static void today_value(size_t i) {
    model_eval(all.x[i], all.today, all.model_room);
}
static void today_gradient(size_t i) {
    model_grad(all.x[i], all.today, all.today + 1, all.model_room);
}
static void today_field(size_t i) {
    model_field(all.x[i], all.u[i], all.today, all.model_room);
}
static void today_step(size_t i) {
    model_step(all.h, all.x[i], all.u[i], all.today, all.model_room);
}

static void written_value(size_t i) {
    p_value(all.x[i], all.written, all.room);
}
static void written_gradient(size_t i) {
    p_grad(all.x[i], all.written, all.written + 1, all.room);
}
static void written_field(size_t i) {
    p_field(all.x[i], all.u[i], all.written, all.room);
}
static void written_step(size_t i) {
    p_step(all.x[i], all.u[i], &all.h, all.written, all.room);
}

#define WAYS_OF(name, what, numbers)                                                                         \
    {                                                                                                        \
        name, numbers, {                                                                                     \
            {"by hand", hand_##what, all.hand}, {"program", plan_##what, all.program},                       \
                {"lg-export", today_##what, all.today}, {                                                    \
                "program's C", written_##what, all.written                                                   \
            }                                                                                                \
        }                                                                                                    \
    }
static const struct {
    const char *name;
    size_t numbers;
    way ways[WAYS];
} functions[FUNCTIONS] = {WAYS_OF("value", value, 1), WAYS_OF("grad", gradient, 1 + D),
                          WAYS_OF("field", field, D), WAYS_OF("step", step, D)};

/* ---- set-up ---- */

static void *reserve(size_t bytes) {
    void *memory = aligned_alloc(64, (bytes + 64) / 64 * 64);
    if (memory == NULL) exit(5);
    return memory;
}

/* Chains: q of length 1, p orthogonal to it. */
static void draw(void) {
    lg_rng rng;
    lg_rng_seed(&rng, 1, 0);
    const int chain = all.file.hamiltonian.run.model.family == lg_hamiltonian_family_find("chain");
    for (size_t i = 0; i < INPUTS; i++) {
        for (size_t k = 0; k < D; k++) {
            all.x[i][k] = lg_rng_normal(&rng);
            all.u[i][k] = lg_rng_normal(&rng);
        }
        for (size_t k = 0; chain && k < D; k += 6) {
            double *q = all.x[i] + k, *p = q + 3, norm = 0, along = 0;
            for (int c = 0; c < 3; c++) norm += q[c] * q[c];
            for (int c = 0; c < 3; c++) q[c] /= sqrt(norm);
            for (int c = 0; c < 3; c++) along += q[c] * p[c];
            for (int c = 0; c < 3; c++) p[c] -= along * q[c];
        }
    }
}

static int open_all(char **argv) {
    lg_error error = {.status = LG_OK};
    lg_program *program = NULL;
    size_t work = 0;
    if (lg_model_load(NULL, argv[1], NULL, &all.file, &error) != LG_OK ||
        lg_program_load(NULL, argv[2], NULL, &program, &error) != LG_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        return 0;
    }
    all.model = all.file.model;
    all.work = reserve(lg_model_work_size(all.model));
    const lg_scheme *scheme = lg_scheme_find(argv[3]);
    if (scheme == NULL || lg_model_inputs(all.model) != D) return 0;
    const size_t bytes = lg_model_stepper_size(all.model, scheme);
    if (lg_model_stepper_init(all.model, scheme, &all.stepper, reserve(bytes), bytes) != LG_OK) return 0;
    lg_plan_options options;
    lg_plan_options_init(&options);
    options.mark_unfit = true; /* as the other three */
    for (size_t f = 0; f < FUNCTIONS; f++) {
        size_t number;
        if (lg_program_find(program, functions[f].name, &number) != LG_OK ||
            lg_plan_create(program, number, &options, &all.plan[f], &error) != LG_OK)
            return 0;
        if (lg_plan_work_size(all.plan[f]) > work) work = lg_plan_work_size(all.plan[f]);
    }
    all.plan_work = reserve(work);
    lg_program_destroy(program);
    return 1;
}

int main(int argc, char **argv) {
    if (argc != 5) return 2;
    if (!open_all(argv)) return 3;
    draw();
    printf("{\"rows\": [");
    for (size_t f = 0; f < FUNCTIONS; f++) {
        if (f > 0) printf(", ");
        bench_ways(functions[f].name, functions[f].ways, WAYS, functions[f].numbers, INPUTS,
                   bench_rounds(argv[4]));
    }
    printf("]}\n");
    return 0;
}
