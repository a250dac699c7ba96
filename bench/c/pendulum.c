/* pendulum FOLDER/p.h5 ROUNDS: compares the gradient of a step of the double pendulum by hand, on the minimal
 * operator tape (bench/cpp/step.cpp), as a program, and as the program's C (p.h, p.c of
 * bench/c/make_programs.c). The ways alternate. */
#include "liegrad/core.h"
#include "liegrad/program.h"
#include "lg-bench/pendulum.h"
#include "p.h"
#include "timing.h"

enum { INPUTS = 64 };

#ifdef HAVE_TAPE
void tape_step_gradient(const double *y, const double *c, double *gradient);
#endif

static struct {
    double y[INPUTS][4], c[INPUTS][4];
    double next[4], by_hand[4], by_tape[4], by_plan[4], by_c[4], y_hand[4], y_plan[4], y_c[4];
    lg_plan *value, *gradient;
    void *work;
    _Alignas(64) double room[p_WORK_SIZE + 1];
} all;

static void hand_value(size_t i) {
    pendulum_stage stage[STAGES];
    memcpy(all.y_hand, all.y[i], sizeof all.y_hand);
    pendulum_step(all.y_hand, stage);
}
static void plan_value(size_t i) {
    const void *in[] = {all.y[i]};
    void *out[] = {all.y_plan};
    lg_plan_eval(all.value, in, out, all.work);
}
static void c_value(size_t i) {
    p_step(all.y[i], all.y_c, all.room);
}
static void hand_gradient(size_t i) {
    pendulum_stage stage[STAGES];
    memcpy(all.next, all.y[i], sizeof all.next);
    pendulum_step(all.next, stage);
    memcpy(all.by_hand, all.c[i], sizeof all.by_hand);
    pendulum_step_adjoint(stage, all.by_hand);
}
static void plan_gradient(size_t i) {
    const void *in[] = {all.y[i], all.c[i]};
    void *out[] = {all.by_plan};
    lg_plan_eval(all.gradient, in, out, all.work);
}
static void c_gradient(size_t i) {
    p_adj1_step(all.y[i], all.c[i], all.by_c, all.room);
}
#ifdef HAVE_TAPE
static void tape_gradient(size_t i) {
    tape_step_gradient(all.y[i], all.c[i], all.by_tape);
}
#endif

static int prepare(const lg_program *program, const char *name, lg_plan **out, size_t *work) {
    size_t function;
    lg_error error = {.status = LG_OK};
    if (lg_program_find(program, name, &function, NULL) != LG_OK ||
        lg_plan_create(program, function, NULL, out, &error) != LG_OK)
        return 0;
    if (lg_plan_work_size(*out) > *work) *work = lg_plan_work_size(*out);
    return 1;
}

int main(int argc, char **argv) {
    lg_program *program;
    lg_error error;
    lg_rng rng;
    size_t work = 0;
    if (argc != 3) return 2;
    if (lg_program_load(NULL, argv[1], NULL, &program, &error) != LG_OK ||
        !prepare(program, "step", &all.value, &work) || !prepare(program, "adj1_step", &all.gradient, &work))
        return 3;
    all.work = aligned_alloc(64, (work + 64) / 64 * 64);
    lg_rng_seed(&rng, 1, 0);
    for (size_t i = 0; i < INPUTS * 4; i++) {
        all.y[i / 4][i % 4] = lg_rng_normal(&rng);
        all.c[i / 4][i % 4] = lg_rng_normal(&rng);
    }
    const size_t rounds = bench_rounds(argv[2]);
    const way values[] = {{"by hand", hand_value, all.y_hand},
                          {"program", plan_value, all.y_plan},
                          {"program's C", c_value, all.y_c}};
    const way gradients[] = {{"by hand", hand_gradient, all.by_hand},
                             {"program", plan_gradient, all.by_plan},
                             {"program's C", c_gradient, all.by_c},
#ifdef HAVE_TAPE
                             {"minimal tape", tape_gradient, all.by_tape}
#endif
    };
    printf("{\"rows\": [");
    bench_ways("step", values, sizeof values / sizeof *values, 4, INPUTS, rounds);
    printf(", ");
    bench_ways("gradient of a step", gradients, sizeof gradients / sizeof *gradients, 4, INPUTS, rounds);
    printf("]}\n");
    return 0;
}
