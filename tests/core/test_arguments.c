/* NULL arguments: what a function that returns an lg_status needs is refused as NULL, whatever the others
 * are. */
#define _GNU_SOURCE /* MAP_ANONYMOUS */
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "autodiff/program_support.h"
#include "support/memory_archive.h"

#include "liegrad/adjoint.h"
#include "liegrad/ensemble.h"
#include "liegrad/gradcheck.h"
#include "liegrad/mechanics.h"
#include "liegrad/minimise.h"
#include "liegrad/program_image.h"
#include "liegrad/train.h"

/* REFUSES(lg_f(NEEDED(a), b, NEEDED(&c))): lg_f is called in children, as it stands and with each needed
 * pointer NULL in turn. As it stands LG_INVALID_ARGUMENT is not its status, so that the other calls have it
 * for the sake of the NULL alone. */
#define NEEDED(p) (nulled(#p) ? NULL : (p))
#define REFUSES(...)                                                                                         \
    for (int which_ = -1; which_ < PAST; which_ = judged(which_, #__VA_ARGS__))                              \
        if (in_child(which_)) _exit(STATUS + (int)(__VA_ARGS__))

enum { STATUS = 100, PAST = 1000 }; /* a child's exit code: STATUS + the lg_status */

static int countdown;        /* needed pointers before the NULL */
static const char **missing; /* in memory shared with the children: the pointer that was NULL, or NULL */
static pid_t child;
static int faults;

static bool nulled(const char *text) {
    if (countdown-- != 0) return false;
    *missing = text;
    return true;
}

static bool in_child(int which) {
    static const int crashes[] = {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL};
    if (missing == NULL)
        missing = mmap(NULL, sizeof *missing, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    assert_true(missing != MAP_FAILED);
    *missing = NULL;
    child = fork();
    assert_true(child >= 0);
    if (child > 0) return false;
    for (size_t i = 0; i < LG_COUNT(crashes); i++) (void)signal(crashes[i], SIG_DFL); /* not cmocka's */
    countdown = which;
    return true;
}

/* The number of the next needed pointer, or PAST. */
static int judged(int which, const char *call) {
    int code = 0;
    assert_int_equal(waitpid(child, &code, 0), child);
    if (which >= 0 && *missing == NULL) return PAST;
    const char *what = which < 0 ? "no pointer" : *missing;
    const bool crashed = !WIFEXITED(code) || WEXITSTATUS(code) < STATUS;
    const lg_status status = crashed ? LG_OK : (lg_status)(WEXITSTATUS(code) - STATUS);
    if (crashed || (status == LG_INVALID_ARGUMENT) != (which >= 0)) {
        print_error("ERROR: %s: %s NULL: %s\n", call, what, crashed ? "a crash" : lg_status_name(status));
        faults++;
    }
    return which + 1;
}

/* All are named before the run fails. */
static int any_faults(void **state) {
    return faults != 0;
}
TEST_GROUP(NULL, any_faults)

static double numbers[4096], others[4096], work[1 << 14];
static lg_error error;

RECORDING(product) {
    y[0] = lg_mul(tape, x[0], theta[0]);
}

TEST("programs") {
    static lg_port in = {.name = "x", .shape = {1, {1, 0, 0, 0}}}, out = {.name = "y"};
    double number = 1.0;
    lg_function_spec function = {"f", &in, 1, &out, 1, product, NULL};
    lg_parameter_spec theta = {"theta", lg_shape1(1), &number};
    lg_program_spec whole = spec_of(&theta, 1, &function, 1), begun = spec_of(&theta, 1, NULL, 0);
    lg_program *program = test_program(&whole), *made, *bare = NULL;
    assert_ok(lg_program_begin(NULL, &begun, &bare, NULL));
    lg_test_owns(bare, release_program);
    lg_function_image *image = NULL, *copy;
    assert_ok(lg_function_image_create(program, 0, &image));
    lg_derivative what;
    lg_derivative_init(&what);
    what.function = "f";
    lg_c_options how;
    lg_c_options_init(&how);
    how.name = "p";
    lg_tape *tape = test_tape(LG_F64);
    lg_var x = lg_input(tape, lg_shape2(1, 1), &number), y;
    size_t index;
    unsigned char pattern[1];
    lg_carry carry = {"y", "x"};
    lg_plan *plan;
    lg_c_source *source;
    const double *inputs[1] = {&number};
    double *outputs[1] = {others};
    REFUSES(lg_program_build(NULL, NEEDED(&whole), NEEDED(&made), NULL));
    REFUSES(lg_program_begin(NULL, NEEDED(&begun), NEEDED(&made), NULL));
    REFUSES(lg_program_find(NEEDED(program), NEEDED("f"), NEEDED(&index)));
    REFUSES(lg_program_set_parameter(NEEDED(program), 0, NEEDED(&number)));
    REFUSES(lg_program_record(NEEDED(tape), NEEDED(program), 0, NULL, NEEDED(&x), NEEDED(&y)));
    REFUSES(lg_program_derive(NEEDED(program), NEEDED(&what), NULL));
    REFUSES(lg_program_sparsity(NEEDED(program), 0, 0, 0, NEEDED(pattern), NULL));
    REFUSES(lg_program_add_loop(NEEDED(program), NEEDED("l"), NEEDED("f"), 2, NEEDED(&carry), 1, NULL));
    REFUSES(lg_plan_create(NEEDED(program), 0, NULL, NEEDED(&plan), NULL));
    REFUSES(lg_program_eval(NULL, NEEDED(program), NEEDED("f"), 1, NEEDED(inputs), NEEDED(outputs), NULL));
    REFUSES(lg_program_write_c(NEEDED(program), NEEDED(&how), NEEDED(&source), NULL));
    REFUSES(lg_function_image_create(NEEDED(program), 0, NEEDED(&copy)));
    REFUSES(lg_program_add_image(NEEDED(bare), NEEDED(image), NULL));
    REFUSES(lg_program_train(NULL, NEEDED(program), NEEDED("f"), NEEDED(inputs), 1, NULL, NULL, NULL));
    lg_function_image_destroy(image);
}

TEST("tapes") {
    lg_tape *tape = test_tape(LG_F64), *made;
    const lg_var x = lg_full(tape, lg_shape1(1), 2.0), y = lg_mul(tape, x, x);
    lg_var out[1];
    void *gradient[1] = {others};
    REFUSES(lg_tape_create(NULL, NULL, NEEDED(&made)));
    REFUSES(lg_tape_rewind(NEEDED(tape), lg_tape_mark(tape)));
    REFUSES(lg_tape_status(NEEDED(tape)));
    REFUSES(lg_read(NEEDED(tape), x, 1, NEEDED(others)));
    REFUSES(lg_grad(NEEDED(tape), y, NEEDED(&x), 1, NEEDED(out)));
    REFUSES(lg_vjp(NEEDED(tape), NEEDED(&y), NEEDED(&x), 1, NEEDED(&x), 1, NEEDED(out)));
    REFUSES(lg_jvp(NEEDED(tape), NEEDED(&y), 1, NEEDED(&x), NEEDED(&x), 1, NEEDED(out)));
    REFUSES(lg_backward(NEEDED(tape), y, NEEDED(&x), 1, NEEDED(gradient)));
    REFUSES(lg_backward_set(NEEDED(tape), y, NEEDED(&x), 1, NEEDED(gradient)));
}

static lg_var square(const void *user, lg_tape *tape, const lg_var *x) {
    return lg_mul(tape, x[0], x[0]);
}

static void no_report(void *user, const lg_gradcheck_case *test, const lg_gradcheck_plant *plant,
                      lg_plant_outcome outcome, const char *reason) {
}

TEST("gradient checks") {
    const lg_gradcheck_argument argument = {.shape = {1, {1, 0, 0, 0}}};
    const lg_gradcheck_case test = {
        .function = {.name = "square", .inputs = 1, .arguments = &argument, .build = square}};
    lg_gradcheck_result result;
    lg_gradcheck_program_result other;
    REFUSES(lg_gradcheck(NULL, NEEDED(&test.function), NULL, NEEDED(&result)));
    REFUSES(lg_gradcheck_run(NULL, NEEDED(&test), NULL, NEEDED(&result)));
    REFUSES(lg_gradcheck_program(NULL, NEEDED(&test), NULL, NEEDED(&other)));
    REFUSES(lg_gradcheck_plant_all(NULL, NEEDED(&test), NULL, NEEDED(no_report), NULL));
}

FIELD(falling, y) {
    out[0] = -y[0];
}

TAPED_FIELD(falling_taped) {
    out[0] = lg_neg(tape, y[0]);
}

static lg_status bind(void *user, lg_tape *tape, lg_var parameters, lg_taped_ode *ode) {
    *ode = *(const lg_taped_ode *)user;
    return LG_OK;
}

static lg_status no_source(void *user, size_t n, double t, const double *y, double *gradient) {
    return LG_OK;
}

TEST("steps") {
    lg_space space;
    assert_ok(lg_space_init_rn(&space, 1));
    lg_ode ode = {.space = space, .field = falling};
    lg_taped_ode taped = {.space = space, .field = falling_taped};
    const lg_scheme *scheme = lg_scheme_find("dp54");
    lg_stepper *stepper = test_stepper(scheme, &ode), *made;
    const lg_space_factor factor = {LG_SPACE_RN, 1};
    assert_ok(lg_step(stepper, 0.0, 0.1, numbers, NULL, others));
    REFUSES(lg_space_init(NEEDED(&space), NEEDED(&factor), 1));
    REFUSES(lg_space_init_rn(NEEDED(&space), 1));
    REFUSES(lg_scheme_check(NEEDED(scheme), NULL));
    REFUSES(lg_stepper_init(NEEDED(scheme), NEEDED(&ode), NEEDED(&made), NEEDED(test_work(sizeof work)),
                            sizeof work));
    REFUSES(lg_stepper_create(NULL, NEEDED(scheme), NEEDED(&ode), NEEDED(&made)));
    REFUSES(lg_step(NEEDED(stepper), 0.0, 0.1, NEEDED(numbers), NULL, NEEDED(others)));
    REFUSES(lg_stepper_dense(NEEDED(stepper), 0.5, NEEDED(others)));
    REFUSES(
        lg_integrate_fixed(NEEDED(stepper), 0.0, 0.1, 1, NULL, 0, 1, NEEDED(numbers), NEEDED(others), NULL));
    REFUSES(lg_integrate_adaptive(NEEDED(stepper), NULL, 0.0, NEEDED(numbers), NEEDED(&(double){1.0}), 1,
                                  NEEDED(others), NULL));

    lg_tape *tape = test_tape(LG_F64);
    const lg_var y = lg_full(tape, lg_shape2(1, 1), 2.0);
    const lg_taped_interval over = {.h = 0.1};
    lg_var out[LG_TAPED_MAX_PARTS];
    REFUSES(lg_taped_split(NEEDED(tape), NEEDED(&space), y, NEEDED(out)));
    REFUSES(lg_taped_act(NEEDED(tape), NEEDED(&space), NEEDED(&y), NEEDED(&y), NEEDED(out)));
    REFUSES(lg_taped_dexpinv(NEEDED(tape), NEEDED(&space), 1, NEEDED(&y), NEEDED(&y), NEEDED(out)));
    REFUSES(lg_taped_generator(NEEDED(tape), NEEDED(&space), NEEDED(&y), NEEDED(&y), NEEDED(out)));
    REFUSES(lg_taped_step_over(NEEDED(tape), NEEDED(scheme), NEEDED(&taped), NEEDED(&over), NEEDED(&y),
                               NEEDED(out)));
    REFUSES(lg_taped_step(NEEDED(tape), NEEDED(scheme), NEEDED(&taped), 0.0, 0.1, NEEDED(&y), NEEDED(out)));
    REFUSES(lg_taped_integrate(NEEDED(tape), NEEDED(scheme), NEEDED(&taped), 0.0, 0.1, 1, 1, NEEDED(&y),
                               NEEDED(out)));

    lg_adjoint_problem problem;
    lg_adjoint_problem_init(&problem);
    problem.scheme = scheme;
    problem.ode = &ode;
    problem.bind = bind;
    problem.source = no_source;
    problem.user = &taped;
    problem.t = numbers;
    problem.h = &(double){0.1};
    problem.steps = 1;
    REFUSES(lg_adjoint_gradient(NULL, NEEDED(&problem), NEEDED(numbers), NULL, NULL, NULL, NULL, NULL));
}

static void release_system(void *system) {
    lg_system_destroy(system);
}

static lg_system *test_system(const char *name, const char *form) {
    lg_system_options options;
    lg_system *system = NULL;
    lg_system_options_init(&options);
    const lg_named_values gravity = {"gravity", &(double){9.81}, 1};
    options.form = form;
    options.parameters = &gravity;
    options.parameter_count = form != NULL;
    if (lg_system_create(NULL, name, &options, &system, &error) != LG_OK) fail_msg("%s", error.message);
    lg_test_owns(system, release_system);
    return system;
}

TEST("systems") {
    lg_system *chain = test_system("pendulum-chain", "hamiltonian"), *made;
    const double *own = lg_system_parameter_values(chain);
    lg_tape *tape = test_tape(LG_F64);
    const lg_var parameters = lg_input(tape, lg_shape1((uint32_t)lg_system_parameter_count(chain)), own);
    const double hanging[6] = {0.0, 0.0, -1.0};
    lg_ode ode;
    lg_taped_ode taped;
    lg_system_user user;
    lg_system_taped_user taped_user;
    lg_rng rng;
    lg_rng_seed(&rng, 1, 0);
    lg_trajectory_options few;
    lg_trajectory_options_init(&few);
    few.trajectories = 2;
    REFUSES(lg_system_create(NULL, NEEDED("oscillator"), NULL, NEEDED(&made), NULL));
    REFUSES(lg_system_copy(NULL, NEEDED(chain), NEEDED(&made)));
    REFUSES(lg_system_set_parameters(NEEDED(chain), NEEDED(own)));
    REFUSES(lg_system_observe(NEEDED(chain), NEEDED(hanging), NEEDED(others), NEEDED(work)));
    REFUSES(lg_system_ode(NEEDED(chain), LG_COORDINATES_LIE, NEEDED(&ode), NEEDED(&user), NEEDED(work)));
    REFUSES(lg_system_taped_ode(NEEDED(chain), LG_COORDINATES_LIE, parameters, NEEDED(&taped),
                                NEEDED(&taped_user)));
    REFUSES(lg_chain_mass_matrix(NEEDED(chain), NEEDED(others)));
    REFUSES(lg_chain_potential_weights(NEEDED(chain), NEEDED(others)));
    REFUSES(lg_chain_momenta(NEEDED(chain), NEEDED(hanging), NEEDED(others), NEEDED(work)));
    REFUSES(lg_chain_velocities(NEEDED(chain), NEEDED(hanging), NEEDED(others), NEEDED(work)));
    REFUSES(
        lg_chain_gradient(NEEDED(chain), NEEDED(hanging), NEEDED(others), NEEDED(others + 3), NEEDED(work)));
    REFUSES(lg_chain_gradient_extended(NEEDED(chain), NEEDED(hanging), NEEDED(others), NEEDED(others + 3),
                                       NEEDED(work)));
    REFUSES(lg_space_start(NEEDED(lg_system_space(chain)), NULL, NEEDED(&rng), NEEDED(others)));
    REFUSES(lg_system_start(NEEDED(chain), NULL, NEEDED(&rng), NEEDED(others)));
    REFUSES(lg_generate_trajectories(NULL, NEEDED(chain), &few, NEEDED(others), NEEDED(others + 100),
                                     NEEDED(others + 200), NULL));
    REFUSES(lg_reference_trajectories(NULL, NEEDED(chain), NEEDED(hanging), 1, NEEDED(&(double){0.1}), 1,
                                      1e-6, 1e-9, NEEDED(others), NULL));
}

TEST("ensembles") {
    lg_system *system = test_system("oscillator", NULL);
    lg_ensemble_options options;
    lg_ensemble_options_init(&options);
    const double times[2] = {0.0, 0.1};
    options.members = 1;
    options.times = times;
    options.count = 2;
    lg_statistics *statistics = NULL, *made;
    assert_ok(lg_statistics_create(NULL, 1, 1, 4, NULL, &statistics));
    memory_archive *archive = TEST_ARRAY(memory_archive, 1), *new = TEST_ARRAY(memory_archive, 1);
    const lg_archive_writer writer = memory_writer(new), first = memory_writer(archive);
    const lg_archive_reader reader = memory_reader(archive);
    assert_ok(lg_statistics_save(statistics, &first));
    REFUSES(lg_ensemble_run(NULL, NEEDED(system), NEEDED(&options), NULL, NULL, NULL, NULL, NULL, NULL));
    REFUSES(lg_statistics_create(NULL, 1, 1, 4, NULL, NEEDED(&made)));
    REFUSES(lg_statistics_like(NEEDED(statistics), NEEDED(&made)));
    REFUSES(lg_statistics_merge(NEEDED(statistics), NEEDED(statistics)));
    REFUSES(lg_statistics_save(NEEDED(statistics), NEEDED(&writer)));
    REFUSES(lg_statistics_load(NEEDED(statistics), NEEDED(&reader)));
    lg_statistics_destroy(statistics);
}

static lg_status bowl(void *user, const double *x, double *value, double *gradient) {
    *value = x[0] * x[0];
    gradient[0] = 2.0 * x[0];
    return LG_OK;
}

static lg_status line(void *user, const double *x, double *r, double *jacobian) {
    r[0] = x[0];
    jacobian[0] = 1.0;
    return LG_OK;
}

TEST("minimisers") {
    double x[1] = {1.0}, matrix[1] = {1.0};
    lg_minimiser *minimiser = NULL, *made;
    assert_ok(lg_minimiser_create(NULL, 1, NULL, x, &minimiser, NULL));
    memory_archive *archive = TEST_ARRAY(memory_archive, 1), *new = TEST_ARRAY(memory_archive, 1);
    const lg_archive_writer writer = memory_writer(new), first = memory_writer(archive);
    const lg_archive_reader reader = memory_reader(archive);
    assert_ok(lg_minimiser_save(minimiser, &first, NULL));
    REFUSES(lg_minimise(NULL, 1, NEEDED(bowl), NULL, NULL, NEEDED(x), NULL, NULL));
    REFUSES(lg_least_squares(NULL, 1, 1, NEEDED(line), NULL, NULL, NEEDED(x), NULL, NULL, NULL));
    REFUSES(lg_normal_equations(1, 1, 1e-12, NEEDED(matrix), NEEDED(x)));
    REFUSES(lg_minimiser_create(NULL, 1, NULL, NEEDED(x), NEEDED(&made), NULL));
    REFUSES(lg_minimiser_status(NEEDED(minimiser)));
    REFUSES(lg_minimiser_collect(NEEDED(minimiser), NULL));
    REFUSES(lg_minimiser_save(NEEDED(minimiser), NEEDED(&writer), NULL));
    REFUSES(lg_minimiser_load(NEEDED(minimiser), NEEDED(&reader), NULL));
    lg_minimiser_destroy(minimiser);
}
