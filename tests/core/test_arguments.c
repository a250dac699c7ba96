/* NULL arguments: a function that returns an lg_status must refuse NULL for every pointer that it needs,
 * whatever its other arguments are. */
#define _GNU_SOURCE /* MAP_ANONYMOUS */
#include <glob.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "support/models.h"
#include "autodiff/program_support.h"
#include "support/machine_models.h"
#include "support/memory_archive.h"

#include "liegrad/anomaly.h"
#include "liegrad/certify.h"
#include "liegrad/classify.h"
#include "liegrad/control.h"
#include "liegrad/core.h"
#include "liegrad/elastica.h"
#include "liegrad/ensemble.h"
#include "liegrad/files.h"
#include "liegrad/fit.h"
#include "liegrad/gradcheck.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/integrators.h"
#include "liegrad/interval.h"
#include "liegrad/lyapunov.h"
#include "liegrad/machine.h"
#include "liegrad/mechanics.h"
#include "liegrad/minimise.h"
#include "liegrad/model.h"
#include "liegrad/networks.h"
#include "liegrad/ops.h"
#include "liegrad/policy.h"
#include "liegrad/program.h"
#include "liegrad/series.h"
#include "liegrad/settings.h"
#include "liegrad/table.h"
#include "liegrad/taped.h"

/* REFUSES(lg_f(NEEDED(a), b, NEEDED(&c))) calls lg_f in child processes: once unchanged, and once for each
 * needed pointer with that pointer NULL. Unchanged it must not return LG_INVALID_ARGUMENT, so that the other
 * calls return it only because of the NULL. */
#define NEEDED(p) (nulled(#p) ? NULL : (p))
#define REFUSES(...)                                                                                         \
    for (int which_ = -1; which_ < PAST; which_ = judged(which_, #__VA_ARGS__))                              \
        if (in_child(which_)) _exit(STATUS + (int)(__VA_ARGS__))

enum { STATUS = 100, PAST = 1000 }; /* exit code of a child: STATUS + the lg_status */

static int countdown;       /* needed pointers that precede the NULL */
static const char **absent; /* in memory shared with the children: the pointer that was NULL, or NULL */
static pid_t child;
static int faults;

static bool nulled(const char *text) {
    if (countdown-- != 0) return false;
    *absent = text;
    return true;
}

static bool in_child(int which) {
    static const int crashes[] = {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL};
    if (absent == NULL)
        absent = mmap(NULL, sizeof *absent, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    assert_true(absent != MAP_FAILED);
    *absent = NULL;
    child = fork();
    assert_true(child >= 0);
    if (child > 0) return false;
    /* not cmocka's handlers */
    for (size_t i = 0; i < LG_COUNT(crashes); i++) (void)signal(crashes[i], SIG_DFL);
    countdown = which;
    return true;
}

static const char *calls[512]; /* the calls as texts */
static size_t call_count;

/* Checks the child's exit code. Returns the number of the next needed pointer, or PAST. */
static int judged(int which, const char *call) {
    int code = 0;
    assert_int_equal(waitpid(child, &code, 0), child);
    if (which < 0 && call_count < LG_COUNT(calls)) calls[call_count++] = call;
    if (which >= 0 && *absent == NULL) return PAST;
    const char *what = which < 0 ? "no pointer" : *absent;
    const bool crashed = !WIFEXITED(code) || WEXITSTATUS(code) < STATUS;
    const lg_status status = crashed ? LG_OK : (lg_status)(WEXITSTATUS(code) - STATUS);
    if (crashed || (status == LG_INVALID_ARGUMENT) != (which >= 0)) {
        print_error("ERROR: %s: %s NULL: %s\n", call, what, crashed ? "a crash" : lg_status_name(status));
        faults++;
    }
    return which + 1;
}

/* Fails the group at the end, after all faults were printed. */
static int any_faults(void **state) {
    return faults != 0 && !lg_test_faulty();
}
TEST_GROUP(NULL, any_faults)

static double numbers[4096], others[4096], work[1 << 14];
static lg_error error;

RECORDING(product) {
    y[0] = lg_mul(tape, x[0], theta[0]);
}

TEST("functions of programs refuse NULL") {
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
    size_t index, size = 0;
    unsigned char pattern[1];
    const lg_carry carry = {"y", "x"};
    lg_loop_spec loop = {sizeof loop, "l", "f", 2, &carry, 1, NULL, 0};
    lg_plan *plan;
    lg_c_source *source;
    const double *inputs[1] = {&number};
    double *outputs[1] = {others};
    REFUSES(lg_program_build(NULL, NEEDED(&whole), NEEDED(&made), NULL));
    REFUSES(lg_program_begin(NULL, NEEDED(&begun), NEEDED(&made), NULL));
    REFUSES(lg_program_find(NEEDED(program), NEEDED("f"), NEEDED(&index), NULL));
    REFUSES(lg_program_set_fitted(NEEDED(program), 0, false));
    REFUSES(lg_program_set_parameter(NEEDED(program), 0, NEEDED(&number)));
    REFUSES(lg_program_record(NEEDED(tape), NEEDED(program), 0, NULL, NEEDED(&x), NEEDED(&y)));
    REFUSES(lg_program_derive(NEEDED(program), NEEDED(&what), NULL));
    REFUSES(lg_program_sparsity(NEEDED(program), 0, 0, 0, NEEDED(pattern), NULL));
    REFUSES(lg_program_add_loop(NEEDED(program), NEEDED(&loop), NULL));
    REFUSES(lg_program_add_function(NEEDED(bare), NEEDED(&function), NULL));
    REFUSES(lg_plan_create(NEEDED(program), 0, NULL, NEEDED(&plan), NULL));
    REFUSES(lg_program_eval(NULL, NEEDED(program), NEEDED("f"), 1, NEEDED(inputs), NEEDED(outputs), NULL));
    REFUSES(lg_program_write_c(NEEDED(program), NEEDED(&how), NEEDED(&source), NULL));
    REFUSES(lg_function_image_create(NEEDED(program), 0, NEEDED(&copy)));
    REFUSES(lg_program_add_image(NEEDED(bare), NEEDED(image), NULL));
    REFUSES(lg_function_pack(NEEDED(image), NULL, NEEDED(&size), NULL));
    REFUSES(lg_function_unpack(NULL, NEEDED("f"), NEEDED("?"), 1, NEEDED(&size), NEEDED(&copy), NULL));
    REFUSES(lg_model_save(NULL, NEEDED("/nonexistent/file.h5"), NEEDED("rotor"), NEEDED(program), NULL, NULL,
                          NULL));
    REFUSES(lg_program_save(NULL, NEEDED("/nonexistent/file.h5"), NEEDED(program), NULL, NULL));
    REFUSES(lg_program_fit(NULL, NEEDED(program), NEEDED("f"), NEEDED(inputs), 1, NULL, NULL, NULL, NULL));
    lg_fit_options of_fit;
    REFUSES(lg_program_fit_options_init(NEEDED(program), NEEDED("f"), NEEDED(&of_fit), NULL));
    REFUSES(lg_program_loss(NULL, NEEDED(program), NEEDED("f"), NEEDED(inputs), 1, NEEDED(others), NULL));
    const lg_program_log log = {.rows = 0};
    lg_program_log_result found = {.error = NULL};
    REFUSES(lg_program_fit_log(NULL, NEEDED(program), NEEDED("f"), NULL, NEEDED(&log), NULL, NEEDED(&found),
                               NULL));
    lg_space line;
    assert_ok(lg_space_init_rn(&line, 1));
    REFUSES(lg_program_add_step(NEEDED(program), NEEDED(&line), NEEDED(lg_scheme_find("rk4")), 0, 1, NULL));
    lg_function_image_destroy(image);
}

TEST("functions of tapes refuse NULL") {
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

TEST("functions of gradient checks refuse NULL") {
    const lg_gradcheck_argument argument = {.shape = {1, {1, 0, 0, 0}}};
    const lg_gradcheck_function function = {
        .name = "square", .inputs = 1, .arguments = &argument, .build = square};
    lg_gradcheck_result result;
    REFUSES(lg_gradcheck(NULL, NEEDED(&function), NULL, NEEDED(&result)));
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

TEST("functions of integrators refuse NULL") {
    lg_space space;
    assert_ok(lg_space_init_rn(&space, 1));
    lg_ode ode = {.space = space, .field = falling};
    lg_taped_ode taped = {.space = space, .field = falling_taped};
    const lg_scheme *scheme = lg_scheme_find("dp54");
    lg_stepper *stepper = test_stepper(scheme, &ode), *made;
    const lg_space_factor factor = {LG_SPACE_RN, 1};
    assert_ok(lg_stepper_step(stepper, 0.0, 0.1, numbers, NULL, others));
    REFUSES(lg_space_init(NEEDED(&space), NEEDED(&factor), 1));
    REFUSES(lg_space_init_rn(NEEDED(&space), 1));
    REFUSES(lg_space_read(NEEDED("R^2"), NEEDED(&space), NULL));
    REFUSES(lg_scheme_check(NEEDED(scheme), NULL));
    REFUSES(lg_stepper_init(NEEDED(scheme), NEEDED(&ode), NEEDED(&made), NEEDED(test_work(sizeof work)),
                            sizeof work));
    REFUSES(lg_stepper_create(NULL, NEEDED(scheme), NEEDED(&ode), NEEDED(&made)));
    REFUSES(lg_stepper_step(NEEDED(stepper), 0.0, 0.1, NEEDED(numbers), NULL, NEEDED(others)));
    REFUSES(lg_stepper_dense(NEEDED(stepper), 0.5, NEEDED(others)));
    REFUSES(
        lg_integrate_fixed(NEEDED(stepper), 0.0, 0.1, 1, NULL, 0, 1, NEEDED(numbers), NEEDED(others), NULL));
    REFUSES(lg_ode_solve(NULL, NEEDED("R^1"), NEEDED(ode.field), NULL, 1.0, NEEDED(&(double){1.0}), 1,
                         NEEDED(numbers), NEEDED(numbers), NULL));
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
    REFUSES(
        lg_taped_step(NEEDED(tape), NEEDED(scheme), NEEDED(&taped), NEEDED(&over), NEEDED(&y), NEEDED(out)));
    REFUSES(
        lg_taped_step(NEEDED(tape), NEEDED(scheme), NEEDED(&taped), OVER(0.0, 0.1), NEEDED(&y), NEEDED(out)));
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

RELEASES(release_system, lg_system_destroy)

static lg_system *test_system(const char *name, const char *form) {
    lg_system_options options;
    lg_system *system = NULL;
    lg_system_options_init(&options);
    const lg_named_values gravity = {"gravity", &(double){9.81}, 1};
    options.form = form;
    options.parameters = &gravity;
    options.parameter_count = form != NULL;
    assert_told(lg_system_create(NULL, name, &options, &system, &told));
    lg_test_owns(system, release_system);
    return system;
}

TEST("functions of systems refuse NULL") {
    lg_system *chain = test_system("pendulum-chain", "hamiltonian"), *made;
    const double *own = lg_system_parameter_values(chain);
    lg_tape *tape = test_tape(LG_F64);
    const lg_var parameters = lg_input(tape, lg_shape1((uint32_t)lg_system_parameter_count(chain)), own);
    const double hanging[6] = {0.0, 0.0, -1.0};
    lg_ode ode;
    lg_taped_ode taped;
    lg_system_user user;
    lg_system_taped_user taped_user;
    lg_rng rng = test_rng(1, 0);
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
    REFUSES(lg_space_draw_start(NEEDED(lg_system_space(chain)), NULL, NEEDED(&rng), NEEDED(others)));
    REFUSES(lg_system_draw_start(NEEDED(chain), NULL, NEEDED(&rng), NEEDED(others)));
    REFUSES(lg_system_generate(NULL, NEEDED(chain), &few, NEEDED(others), NEEDED(others + 100),
                               NEEDED(others + 200), NULL));
    REFUSES(lg_system_solve(NULL, NEEDED(chain), NEEDED(hanging), 1, NEEDED(&(double){0.1}), 1, 1e-6, 1e-9,
                            NEEDED(others), NULL));
}

TEST("functions of ensembles refuse NULL") {
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
    REFUSES(lg_statistics_create_like(NEEDED(statistics), NEEDED(&made)));
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

TEST("functions of minimisers refuse NULL") {
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

static lg_status fit_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                          size_t batch, lg_var *loss) {
    *loss = lg_sum(tape, lg_mul(tape, theta, theta));
    return lg_tape_status(tape);
}

TEST("functions of networks and fits refuse NULL") {
    lg_fit_plan plan;
    lg_mlp mlp;
    lg_net net;
    lg_tape *tape = test_tape(LG_F64);
    const lg_var theta = lg_input(tape, lg_shape1(64), numbers), x = lg_full(tape, lg_shape2(1, 1), 1.0);
    lg_mlp_vars vars;
    lg_var out[2];
    assert_ok(lg_mlp_init(&mlp, 1, NULL, 0, 1, LG_TANH, true));
    assert_ok(lg_net_init(&net, LG_NET_MLP, 1, 1, 2, 1, 1, LG_TANH));
    REFUSES(lg_fit_plan_parse(NEEDED("adam"), true, NEEDED(&plan), NULL));
    REFUSES(lg_mlp_init(NEEDED(&mlp), 1, NEEDED(&(uint32_t){2}), 1, 1, LG_TANH, true));
    assert_ok(lg_mlp_init(&mlp, 1, NULL, 0, 1, LG_TANH, true));
    REFUSES(lg_mlp_bind(NEEDED(tape), NEEDED(&mlp), theta, 0, NEEDED(&vars)));
    REFUSES(lg_net_init(NEEDED(&net), LG_NET_MLP, 1, 1, 2, 1, 1, LG_TANH));
    REFUSES(lg_net_record_jvp(NEEDED(tape), NEEDED(&net), theta, 0, x, x, NEEDED(out), NEEDED(out + 1)));

    lg_fit_problem problem = {.parameters = 1, .samples = 2, .loss = fit_loss};
    lg_fit *fit = NULL, *made;
    assert_ok(lg_fit_create(NULL, &problem, NULL, numbers, &fit, NULL));
    memory_archive *archive = TEST_ARRAY(memory_archive, 1), *new = TEST_ARRAY(memory_archive, 1);
    const lg_archive_writer writer = memory_writer(new), first = memory_writer(archive);
    const lg_archive_reader reader = memory_reader(archive);
    assert_ok(lg_fit_save(fit, &first, NULL));
    REFUSES(lg_fit_create(NULL, NEEDED(&problem), NULL, NEEDED(numbers), NEEDED(&made), NULL));
    REFUSES(lg_fit_run(NEEDED(fit), NULL));
    REFUSES(lg_fit_save(NEEDED(fit), NEEDED(&writer), NULL));
    REFUSES(lg_fit_load(NEEDED(fit), NEEDED(&reader), NULL));
    REFUSES(lg_fit_newton(NULL, NEEDED(&problem), NEEDED(others), NULL));
    REFUSES(lg_fit_problem_loss(NULL, NEEDED(&problem), NEEDED(numbers), NEEDED(others), NULL));
    lg_fit_destroy(fit);
}

/* The plane x = 0 in R^3, with the potential x. */
static lg_status first_number(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user, (void)theta;
    *y = lg_slice(tape, x[0], 1, 0, 1);
    return lg_tape_status(tape);
}

TEST("functions of constraints refuse NULL") {
    const lg_port q = {.name = "q", .shape = lg_shape1(3)}, g = {.name = "g"};
    const lg_function_spec functions[] = {{"constraint", &q, 1, &g, 1, first_number, NULL},
                                          {"potential", &q, 1, &g, 1, first_number, NULL}};
    const double y[6] = {0, 1, 2, 0, 1, 0}, t[2] = {0, 1};
    double out[12], state[6] = {0, 1, 2, 0, 1, 0};
    lg_program_spec spec;
    lg_program *program;
    lg_constraint *c;
    lg_constraint_view view;
    lg_trajectory_options how;
    lg_trajectories data = {.family = lg_hamiltonian_family_find("constrained"), .n = 3};
    lg_error *const none = NULL;
    lg_program_spec_init(&spec);
    spec.functions = functions;
    spec.function_count = 2;
    assert_ok(lg_program_build(NULL, &spec, &program, NULL));
    assert_ok(lg_constraint_create(NULL, program, &c, NULL));
    lg_trajectory_options_init(&how);
    how.trajectories = 1;
    how.points = 2;
    REFUSES(lg_constraint_create(NULL, NEEDED(program), NEEDED(&c), none));
    REFUSES(lg_constraint_look(NEEDED(c), 0, NEEDED(y), NEEDED(&view), none));
    REFUSES(lg_constraint_project(NEEDED(c), 0, NEEDED(state), none));
    REFUSES(lg_constraint_energy(NEEDED(c), NEEDED(y), NEEDED(out), none));
    REFUSES(lg_constraint_rattle(NEEDED(c), 2, 0.1, 1, 1, NEEDED(y), NEEDED(out), none));
    REFUSES(lg_constraint_flow(NEEDED(c), 1e-6, NEEDED(t), 2, NEEDED(y), NEEDED(out), none));
    REFUSES(lg_constraint_generate(NEEDED(c), NEEDED(&how), NULL, NEEDED(out), NULL, none));
    REFUSES(lg_trajectories_set_constraint(NEEDED(&data), NEEDED(program), none));
    lg_constraint_destroy(c);
    lg_program_destroy(program);
}

RELEASES(release_model, lg_model_destroy)

TEST("functions of Hamiltonians, models and control refuse NULL") {
    const lg_hamiltonian_family *family = lg_hamiltonian_family_find("separable");
    const lg_scheme *scheme = lg_scheme_find("rk4");
    lg_hamiltonian h;
    lg_hamiltonian_scales scales;
    lg_space space;
    lg_error *const none = NULL;
    const uint32_t hidden = 3;
    assert_ok(lg_hamiltonian_init(&h, family, 1, LG_POTENTIAL_MLP, &hidden, 1, LG_TANH));
    const size_t count = lg_hamiltonian_parameters(&h);
    const double *theta = test_numbers(1, count, 0.1, 1.0), *data = test_numbers(2, 64, -1.0, 1.0);
    double *changed = TEST_ARRAY(double, count);
    memcpy(changed, theta, count * sizeof *theta);
    lg_hamiltonian_problem problem = {.model = &h,
                                      .scheme = scheme,
                                      .substeps = 1,
                                      .trajectories = 2,
                                      .points = 3,
                                      .dt = 0.1,
                                      .data = data,
                                      .penalty = 1.0,
                                      .penalty_integral = lg_first_integral_find("oscillator")};
    lg_tape *tape = test_tape(LG_F64);
    const lg_var at = lg_input(tape, lg_shape1((uint32_t)count), theta);
    lg_hamiltonian_vars vars;
    lg_program *program;
    assert_ok(lg_hamiltonian_bind(tape, &h, at, &vars));
    REFUSES(lg_hamiltonian_space(NEEDED(family), 1, NEEDED(&space)));
    REFUSES(
        lg_hamiltonian_init(NEEDED(&h), NEEDED(family), 1, LG_POTENTIAL_MLP, NEEDED(&hidden), 1, LG_TANH));
    REFUSES(lg_hamiltonian_set_symmetry(NEEDED(&h), LG_SYMMETRY_ODD));
    REFUSES(lg_hamiltonian_mass(NEEDED(&h), NEEDED(theta), NEEDED(others)));
    REFUSES(lg_hamiltonian_problem_check(NEEDED(&problem), none));
    REFUSES(lg_hamiltonian_find_scales(NEEDED(&problem), NEEDED(&scales), none));
    REFUSES(lg_hamiltonian_weigh(NEEDED(&problem), none));
    REFUSES(lg_hamiltonian_mean_squared_error(NULL, NEEDED(&problem), NEEDED(theta), NEEDED(others), none));
    REFUSES(lg_hamiltonian_integral_unit(NULL, NEEDED(&problem), NEEDED(others), none));
    REFUSES(lg_hamiltonian_floor(NULL, NEEDED(&problem), NEEDED(theta), NEEDED(others), none));
    REFUSES(lg_hamiltonian_scale(NULL, NEEDED(&problem), NEEDED(changed), NULL));
    REFUSES(lg_hamiltonian_bind(NEEDED(tape), NEEDED(&h), at, NEEDED(&vars)));
    REFUSES(lg_hamiltonian_program(NULL, NEEDED(&h), NEEDED(theta), NULL, NEEDED(&program), none));

    lg_model *model = NULL, *made;
    lg_plan *plan;
    lg_first_integral integral;
    assert_ok(lg_hamiltonian_program(NULL, &h, theta, NULL, &program, none));
    lg_test_owns(program, release_program);
    REFUSES(lg_first_integral_from(NEEDED(program), NEEDED(&h), NEEDED("G"), NEEDED(&integral), none));
    assert_ok(test_hamiltonian_model(NULL, &h, theta, &model, none));
    lg_test_owns(model, release_model);
    lg_ode ode;
    lg_model_user user;
    lg_stepper *stepper;
    double state[2] = {0.1, 0.2};
    void *room = test_work(1 << 20);
    lg_trajectories set = {.count = 0}, new;
    assert_ok(lg_trajectories_create(NULL, "oscillator", family, 1, 2, 3, 0.2, false, 0, &set));
    REFUSES(lg_trajectories_create(NULL, NEEDED("oscillator"), NEEDED(family), 1, 2, 3, 0.2, false, 0,
                                   NEEDED(&new)));
    REFUSES(lg_trajectories_set_truth(NEEDED(&set), NEEDED(test_system("oscillator", NULL))));
    REFUSES(lg_trajectories_write(NULL, NEEDED("/nonexistent/file.h5"), NEEDED(&set), NULL));
    lg_trajectories_destroy(&set);
    REFUSES(lg_model_create(NULL, NEEDED(program), NULL, NEEDED(&made), none));
    REFUSES(lg_model_find(NEEDED(model), NEEDED("field"), NULL, NEEDED(&plan), none));
    REFUSES(lg_model_field(NEEDED(model), NEEDED(state), NULL, NEEDED(others), NEEDED(work)));
    REFUSES(lg_model_ode(NEEDED(model), NEEDED(&ode), NEEDED(&user), NEEDED(work)));
    REFUSES(lg_model_stepper_init(NEEDED(model), NEEDED(scheme), NEEDED(&stepper), NEEDED(room), 1 << 20));
    REFUSES(lg_model_linearise(NEEDED(model), NEEDED(state), NULL, NULL, NULL, NULL, NEEDED(work)));
    REFUSES(lg_model_deviation(NEEDED(model), NEEDED(state), NEEDED(state), NEEDED(others), NEEDED(work)));
    REFUSES(lg_model_retract(NEEDED(model), NEEDED(state), NEEDED(numbers), NEEDED(others), NEEDED(work)));
    REFUSES(lg_model_equilibrium(NEEDED(model), NULL, NEEDED(state), NULL, NEEDED(work)));
    REFUSES(
        lg_model_machine_state(NEEDED(model), NEEDED(state), NEEDED(state), NEEDED(others), NEEDED(work)));
    REFUSES(lg_model_machine_velocities(NEEDED(model), NEEDED(state), NEEDED(others), NEEDED(work)));
    REFUSES(lg_model_machine_positions(NEEDED(model), NEEDED(state), NEEDED(others), NEEDED(work)));

    const double one[1] = {1.0};
    const lg_riccati equation = {sizeof equation, 1, 1, one, one, one, one, NULL};
    REFUSES(lg_care(NEEDED(&equation), NULL, NULL, NULL, NULL, NEEDED(room), 1 << 20, none));
    REFUSES(lg_dare(NEEDED(&equation), NULL, NULL, NULL, NULL, NEEDED(room), 1 << 20, none));
    REFUSES(lg_zero_order_hold(1, 1, NEEDED(one), NEEDED(one), 0.1, NEEDED(others), NEEDED(others + 1),
                               NEEDED(room), 1 << 20, none));
    lg_lqr_options lqr;
    lg_lqr_options_init(&lqr);
    lqr.state = state, lqr.Q = (const double[]){1.0, 0.0, 0.0, 1.0}, lqr.R = one;
    lqr.most_drift = 1e9;
    lg_lqr regulator;
    void *second = test_work(1 << 20);
    lg_sensor sensor = {LG_SENSOR_STATE, 0, 0.1, 0.0};
    lg_ekf_options noisy;
    lg_ekf_options_init(&noisy);
    noisy.scheme = scheme, noisy.state = state, noisy.P = noisy.W = lqr.Q;
    noisy.sensors = &sensor, noisy.sensor_count = 1;
    lg_ekf *ekf = NULL;
    assert_ok(lg_ekf_init(model, &noisy, &ekf, second, 1 << 20, &error));
    REFUSES(lg_ekf_init(NEEDED(model), NEEDED(&noisy), NEEDED(&ekf), NEEDED(room), 1 << 20, none));
    REFUSES(lg_ekf_predict(NEEDED(ekf), 0.1, NULL));
    REFUSES(lg_ekf_update(NEEDED(ekf), NEEDED(one), NULL));
    assert_told(lg_lqr_init(model, &lqr, &regulator, second, 1 << 20, &told));
    REFUSES(lg_lqr_control(NEEDED(&regulator), NEEDED(state), NEEDED(others)));
    REFUSES(lg_lqr_init(NEEDED(model), NEEDED(&lqr), NEEDED(&regulator), NEEDED(room), 1 << 20, none));
}

TEST("functions of elastica and surrogates refuse NULL") {
    lg_elastica problem;
    lg_elastica_init(&problem);
    problem.intervals = 10;
    lg_elastica_options options;
    lg_elastica_options_init(&options);
    lg_elastica_solution solutions[2];
    size_t count;
    lg_elastica_sampling sampling;
    lg_elastica_sampling_init(&sampling);
    sampling.count = 2;
    sampling.problem.intervals = 10;
    lg_elastica_curves curves, made;
    assert_ok(lg_elastica_generate(NULL, &sampling, &curves, &error));
    REFUSES(lg_elastica_check(NEEDED(&problem), NULL));
    REFUSES(lg_elastica_solve(NULL, NEEDED(&problem), NULL, NEEDED(others), NULL, NULL));
    REFUSES(lg_elastica_solve_continuous(NULL, NEEDED(&problem), NULL, NEEDED(others), NULL, NULL, NULL));
    REFUSES(lg_elastica_branches(NULL, NEEDED(&problem), NULL, false, 2, NEEDED(others), NEEDED(solutions),
                                 NEEDED(&count), NULL));
    REFUSES(lg_elastica_generate(NULL, NEEDED(&sampling), NEEDED(&made), NULL));

    lg_surrogate_options how = {.architecture = LG_NET_MLP,
                                .embedding = 3,
                                .hidden = 3,
                                .layers = 1,
                                .activation = LG_TANH,
                                .modes = 1};
    lg_surrogate model;
    assert_ok(lg_surrogate_init(&model, &how, 10, 3.3, 1.5, &error));
    double *modes = TEST_ARRAY(double, 1000), *theta = TEST_ARRAY(double, lg_surrogate_parameters(&model));
    const uint32_t training[2] = {0, 1};
    uint32_t found;
    uint8_t parts[2];
    assert_ok(lg_surrogate_find_modes(NULL, &model, &curves, training, 2, modes, &error));
    model.modes = modes;
    lg_surrogate_problem learned = {.model = &model,
                                    .curves = &curves,
                                    .training = training,
                                    .training_count = 2,
                                    .coefficients = numbers};
    lg_surrogate_curves *plan;
    lg_surrogate_errors errors;
    lg_program *program;
    REFUSES(lg_surrogate_init(NEEDED(&model), NEEDED(&how), 10, 3.3, 1.5, NULL));
    REFUSES(lg_surrogate_count_modes(NULL, NEEDED(&model), NEEDED(&curves), NEEDED(training), 2,
                                     NEEDED(&found), NULL));
    REFUSES(lg_surrogate_find_modes(NULL, NEEDED(&model), NEEDED(&curves), NEEDED(training), 2, NEEDED(modes),
                                    NULL));
    REFUSES(lg_surrogate_coefficients(NULL, NEEDED(&model), NEEDED(&curves), NEEDED(training), 2,
                                      NEEDED(others), NULL, NULL));
    REFUSES(lg_surrogate_split(2, 0.5, 0.5, 1, NEEDED(parts)));
    REFUSES(lg_surrogate_problem_check(NEEDED(&learned), NULL));
    REFUSES(lg_surrogate_program(NULL, NEEDED(&model), NEEDED(theta), NEEDED(&program), NULL));
    REFUSES(lg_surrogate_curves_create(NULL, NEEDED(&model), NEEDED(theta), LG_F64, 3, NEEDED(&plan), NULL));
    REFUSES(lg_surrogate_evaluate(NULL, NEEDED(&model), NEEDED(theta), NEEDED(&curves), NULL, 0, NULL,
                                  NEEDED(&errors), NULL));
    lg_elastica_curves_destroy(&curves);
}

TEST("functions of tables and files refuse NULL") {
    static lg_table_options shape = {
        .network = LG_NET_MLP, .activation = LG_TANH, .hidden_count = 1, .hidden = {3}, .linear = true};
    lg_table model;
    lg_scaler scaler;
    lg_program *program;
    const double *values = test_numbers(3, 16, -1.0, 1.0);
    assert_ok(lg_table_init(&model, &shape, 2, 2, &error));
    assert_ok(lg_table_scaler_fit(NULL, values, 2, NULL, 8, &scaler));
    double *theta = TEST_ARRAY(double, lg_table_parameters(&model));
    REFUSES(lg_table_init(NEEDED(&model), NEEDED(&shape), 2, 2, NULL));
    REFUSES(lg_table_scaler_fit(NULL, NEEDED(values), 2, NULL, 8, NEEDED(&scaler)));
    REFUSES(lg_table_program(NULL, NEEDED(&model), NEEDED(&scaler), NEEDED(&scaler), NEEDED(theta),
                             NEEDED(&program), NULL));
    REFUSES(
        lg_table_fit(NULL, NEEDED(values), 1, NEEDED(values + 8), 1, 8, NULL, NEEDED(&program), NULL, NULL));
    lg_scaler_destroy(&scaler);

    static const char path[] = "/nonexistent/file.h5", text[] = "coordinates:";
    lg_table_names names;
    lg_table_data table;
    lg_tensors tensors;
    const char *const column = "a";
    REFUSES(lg_table_names_read(NULL, NEEDED(path), NULL, NEEDED(&names), NULL));
    REFUSES(lg_table_read(NULL, NEEDED(path), NEEDED(&column), 1, NULL, NULL, NEEDED(&table), NULL));
    REFUSES(lg_tensors_read(NULL, NEEDED(path), NEEDED(&tensors), NULL));

    double number;
    uint64_t integer;
    lg_temporary temporary;
    lg_lock lock;
    bool ours;
    lg_file_writer *writer;
    lg_file_reader *reader;
    lg_rows_about about;
    lg_trajectories trajectories;
    lg_hamiltonian_file hamiltonian;
    lg_surrogate_file surrogate;
    lg_detector_file detector;
    lg_table_file filed;
    lg_machine_model_file machine_model;
    lg_elastica_data elastica;
    lg_series_data series;
    lg_model_file file;
    lg_search_file search;
    lg_scene scene;
    lg_scheme *scheme;
    lg_grid grid;
    lg_machine_file machine;
    char kind[64];
    REFUSES(lg_file_is_h5(NEEDED(path), NEEDED(&ours), NULL));
    REFUSES(lg_file_is_ours(NULL, NEEDED(path), NEEDED(&ours), NULL));
    REFUSES(lg_file_write(NULL, NEEDED(path), NEEDED(text), sizeof text, NULL));
    REFUSES(lg_temporary_create(NULL, NEEDED(path), false, NEEDED(&temporary), NULL));
    REFUSES(lg_temporary_publish(NEEDED(&temporary), NEEDED(path), NULL));
    REFUSES(lg_lock_take(NULL, NEEDED(path), NEEDED(text), NEEDED(&lock), NULL));
    REFUSES(lg_number_parse(NEEDED("1"), NEEDED(&number)));
    REFUSES(lg_integer_parse(NEEDED("1"), NEEDED(&integer)));
    REFUSES(lg_file_writer_create(NULL, NEEDED(path), NEEDED("model"), NULL, NEEDED(&writer), NULL));
    REFUSES(lg_rows_file_look(NULL, NEEDED(path), NEEDED(&about), NULL, 0, NULL));
    REFUSES(lg_file_reader_create(NULL, NEEDED(path), NULL, NULL, NEEDED(&reader), NULL));
    REFUSES(lg_trajectories_read(NULL, NEEDED(path), NULL, NEEDED(&trajectories), NULL));
    REFUSES(
        lg_recipe_load(NULL, NEEDED(path), NULL, NEEDED(&lg_recipe_hamiltonian), NEEDED(&hamiltonian), NULL));
    REFUSES(lg_elastica_data_read(NULL, NEEDED(path), NULL, NEEDED(&elastica), NULL));
    REFUSES(lg_recipe_load(NULL, NEEDED(path), NULL, NEEDED(&lg_recipe_surrogate), NEEDED(&surrogate), NULL));
    REFUSES(lg_series_read(NULL, NEEDED(path), NULL, NULL, NEEDED(&series), NULL));
    REFUSES(lg_recipe_load(NULL, NEEDED(path), NULL, NEEDED(&lg_recipe_detector), NEEDED(&detector), NULL));
    REFUSES(lg_recipe_load(NULL, NEEDED(path), NULL, NEEDED(&lg_recipe_table), NEEDED(&filed), NULL));
    REFUSES(lg_recipe_load(NULL, NEEDED(path), NULL, NEEDED(&lg_recipe_machine_model), NEEDED(&machine_model),
                           NULL));
    REFUSES(lg_program_load(NULL, NEEDED(path), NULL, NEEDED(&program), NULL));
    REFUSES(lg_model_file_kind(NULL, NEEDED(path), NULL, NEEDED(kind), sizeof kind, NULL));
    REFUSES(lg_model_load(NULL, NEEDED(path), NULL, NEEDED(&file), NULL));
    REFUSES(lg_search_file_read(NULL, NEEDED(path), NEEDED(&search), NULL));
    REFUSES(lg_scene_read(NULL, NEEDED(path), NULL, NEEDED(&scene), NULL));
    REFUSES(lg_scheme_read(NULL, NEEDED(path), NEEDED(&scheme), NULL));
    REFUSES(lg_grid_read(NULL, NEEDED(path), NEEDED(&grid), NULL));
    REFUSES(lg_machine_file_read(NULL, NEEDED(path), NEEDED(&machine), NULL));
    REFUSES(lg_machine_file_parse(NULL, NEEDED("machine"), NEEDED(text), sizeof text - 1, NEEDED(&machine),
                                  NULL));
}

static lg_status judge(void *user, const float *x, uint32_t missing, lg_answer *answer, double *score) {
    return LG_OK;
}

TEST("functions of series and classifiers refuse NULL") {
    lg_series series = {.count = 12, .channels = 1, .length = 8, .classes = 2}, other = series;
    lg_windows windows, cut;
    lg_scaler scaler;
    uint8_t parts[12];
    uint32_t fold[12];
    assert_ok(lg_series_allocate(NULL, &series, false, false));
    for (int i = 0; i < 96; i++) series.x[i] = (float)sin(i * i);
    for (int i = 0; i < 12; i++) series.label[i] = i % 2;
    assert_ok(lg_windows_create(NULL, &series, 0, 0, &windows, NULL));
    REFUSES(lg_series_allocate(NULL, NEEDED(&other), false, false));
    REFUSES(lg_windows_create(NULL, NEEDED(&series), 0, 0, NEEDED(&cut), NULL));
    REFUSES(lg_series_split(NULL, NEEDED(&series), NEEDED(&windows), (lg_split)0, 0.25, 0.25, 1,
                            NEEDED(parts), NULL));
    REFUSES(lg_series_folds(NULL, NEEDED(series.label), NULL, 12, 2, NEEDED(fold), NULL));
    REFUSES(lg_scaler_fit(NULL, NEEDED(&series), NEEDED(&windows), NULL, 12, true, NEEDED(&scaler)));

    lg_spectrum spectrum;
    lg_novelty novelty;
    lg_novelty_options options;
    lg_novelty_options_init(&options);
    REFUSES(lg_spectrum_create(NULL, 8, 1, NEEDED(&spectrum), NULL));
    REFUSES(lg_novelty_fit(NULL, NEEDED(&options), NEEDED(&series), NEEDED(&windows), NULL, 12, 1,
                           NEEDED(&novelty), NULL));
    memory_archive *saved = TEST_ARRAY(memory_archive, 1), *again = TEST_ARRAY(memory_archive, 1);
    const lg_archive_writer to = memory_writer(saved), to_another = memory_writer(again);
    const lg_archive_reader from = memory_reader(saved);
    assert_told(lg_novelty_fit(NULL, &options, &series, &windows, NULL, 12, 1, &novelty, &told));
    assert_ok(lg_novelty_save(&novelty, &to, NULL));
    REFUSES(lg_novelty_save(NEEDED(&novelty), NEEDED(&to_another), NULL));
    REFUSES(lg_novelty_load(NULL, NEEDED(&from), NEEDED(&novelty), NULL));
    lg_novelty_destroy(&novelty);
    lg_monitor_options watch;
    lg_monitor_options_init(&watch);
    watch.channels = 1, watch.window = 8, watch.hop = 8;
    lg_monitor *monitor = NULL;
    void *room = test_work(1 << 16);
    bool ready;
    lg_verdict verdict;
    assert_ok(lg_monitor_init(&watch, judge, NULL, &monitor, room, 1 << 16, &error));
    REFUSES(
        lg_monitor_init(NEEDED(&watch), NEEDED(judge), NULL, NEEDED(&monitor), NEEDED(room), 1 << 16, NULL));
    REFUSES(lg_monitor_push(NEEDED(monitor), NULL, NEEDED(&ready), NEEDED(&verdict)));

    lg_features features, made;
    lg_pca pca;
    lg_logistic logistic;
    lg_tree tree, pruned;
    lg_tree_options growth;
    lg_tree_options_init(&growth);
    lg_pruning_step steps[8];
    lg_svm svm;
    lg_classifier_options chain, *grid = &chain;
    lg_classifier_options_init(&chain);
    lg_classifier classifier = {0};
    lg_program *program;
    size_t count;
    const double *x = test_numbers(4, 24, -1.0, 1.0);
    const uint32_t *label = series.label;
    assert_ok(lg_features_create(NULL, LG_FEATURES_STD, false, &series, 8, NULL, &features, &error));
    assert_ok(lg_tree_fit(NULL, &growth, x, label, 12, 2, 2, &tree, &error));
    assert_ok(lg_svm_fit(NULL, LG_KERNEL_LINEAR, 1.0, 0.0, x, label, 12, 2, 2, &svm, &error));
    REFUSES(lg_features_create(NULL, LG_FEATURES_STD, false, NEEDED(&series), 8, NULL, NEEDED(&made), NULL));
    REFUSES(lg_features_compute(NEEDED(&features), NEEDED(series.x), NEEDED(others), NEEDED(work)));
    REFUSES(lg_features_table(NULL, NEEDED(&features), NEEDED(&series), NEEDED(&windows), 1, NEEDED(others),
                              NULL));
    REFUSES(lg_pca_fit(NULL, NEEDED(x), 12, 2, 1, NEEDED(&pca), NULL));
    REFUSES(lg_logistic_fit(NULL, NEEDED(x), NEEDED(label), 12, 2, 2, 1.0, NEEDED(&logistic), NULL));
    lg_rocket_options convolutions;
    lg_rocket_options_init(&convolutions);
    lg_series long_series = {.count = 2, .channels = 1, .length = 9, .classes = 2};
    lg_windows long_windows;
    lg_features convolved;
    double zero = 0, one = 1;
    const lg_scaler unit = {.channels = 1, .mean = &zero, .scale = &one};
    const uint32_t kept[] = {0};
    assert_ok(lg_series_allocate(NULL, &long_series, false, false));
    assert_ok(lg_windows_create(NULL, &long_series, 9, 9, &long_windows, &error));
    convolutions.features = 96;
    REFUSES(lg_rocket_fit(NULL, NEEDED(&convolutions), NEEDED(&long_series), NEEDED(&long_windows), NULL, 2,
                          NEEDED(&unit), NEEDED(&made), NULL));
    assert_ok(
        lg_rocket_fit(NULL, &convolutions, &long_series, &long_windows, NULL, 2, &unit, &convolved, &error));
    REFUSES(lg_rocket_prune(NEEDED(&convolved), NEEDED(kept), 1, NULL));
    lg_features_destroy(&convolved);
    lg_windows_destroy(&long_windows);
    lg_series_destroy(&long_series);
    REFUSES(lg_ridge_fit(NULL, NEEDED(others), NEEDED(label), 12, 2, 2, 1, NEEDED(&logistic), NULL));
    REFUSES(lg_tree_fit(NULL, NEEDED(&growth), NEEDED(x), NEEDED(label), 12, 2, 2, NEEDED(&pruned), NULL));
    REFUSES(lg_tree_pruning_path(NULL, NEEDED(&tree), 8, NEEDED(steps), NEEDED(&count)));
    REFUSES(lg_tree_prune(NULL, NEEDED(&tree), 0.0, NEEDED(&pruned)));
    REFUSES(
        lg_svm_fit(NULL, LG_KERNEL_LINEAR, 1.0, 0.0, NEEDED(x), NEEDED(label), 12, 2, 2, NEEDED(&svm), NULL));
    REFUSES(lg_svm_plane(NEEDED(&svm), NEEDED(others), NEEDED(others + 2)));
    REFUSES(lg_classifier_fit(NULL, NEEDED(&chain), NEEDED(x), NEEDED(label), NULL, 12, 2, 2,
                              NEEDED(&classifier), NULL));
    REFUSES(lg_classifier_search(NULL, NEEDED(grid), 1, 2, NEEDED(x), NEEDED(label), NULL, NULL, 12, 2, 2, 1,
                                 NEEDED(others), NEEDED(&count), NULL));
    lg_classifier fitted = {.features = features}, loaded;
    assert_ok(lg_classifier_fit(NULL, &chain, x, label, NULL, 12, 1, 2, &fitted, &error));
    uint32_t largest[1];
    REFUSES(lg_classifier_largest(NULL, NEEDED(&fitted), 1, 1, NEEDED(largest), NULL));
    memory_archive *archive = TEST_ARRAY(memory_archive, 1), *new = TEST_ARRAY(memory_archive, 1);
    const lg_archive_writer writer = memory_writer(new), first = memory_writer(archive);
    const lg_archive_reader reader = memory_reader(archive);
    assert_ok(lg_classifier_save(&fitted, &first, NULL));
    REFUSES(lg_classifier_window(NEEDED(&fitted), NEEDED(series.x), NEEDED(others), NEEDED(work)));
    REFUSES(lg_classifier_program(NULL, NEEDED(&fitted), NEEDED(&program), NULL));
    REFUSES(lg_classifier_save(NEEDED(&fitted), NEEDED(&writer), NULL));
    REFUSES(lg_classifier_load(NULL, NEEDED(&reader), NEEDED(&loaded), NULL));
    fitted.features = (lg_features){.count = 0};
    lg_classifier_destroy(&fitted);

    lg_detector detector = {
        .net = {.channels = 1, .length = 8, .outputs = 2, .plane = 2, .activation = LG_TANH},
        .classes = 2,
        .loss = LG_DETECTOR_CROSS_ENTROPY};
    lg_detector_data data, taken;
    lg_detector_units units;
    lg_detector_plan *plan;
    assert_ok(lg_cnn_init(&detector.net, &error));
    assert_ok(lg_scaler_fit(NULL, &series, &windows, NULL, 12, true, &scaler));
    assert_ok(lg_detector_data_create(NULL, &detector, &scaler, &series, &windows, NULL, 12, LG_F64, &data,
                                      &error));
    const double *theta = test_numbers(5, lg_cnn_parameters(&detector.net), -1.0, 1.0);
    const lg_detector_problem learned = {.model = &detector, .data = &data, .training = 12};
    REFUSES(lg_cnn_init(NEEDED(&detector.net), NULL));
    REFUSES(lg_detector_check(NEEDED(&detector), NULL));
    REFUSES(lg_detector_data_create(NULL, NEEDED(&detector), NEEDED(&scaler), NEEDED(&series),
                                    NEEDED(&windows), NULL, 12, LG_F64, NEEDED(&taken), NULL));
    REFUSES(lg_detector_count_units(NEEDED(&learned), NEEDED(theta), NEEDED(&units)));
    REFUSES(
        lg_detector_program(NULL, NEEDED(&detector), NEEDED(&scaler), NEEDED(theta), NEEDED(&program), NULL));
    REFUSES(lg_detector_plan_create(NULL, NEEDED(&detector), NEEDED(&scaler), NEEDED(theta), LG_F64,
                                    NEEDED(&plan), NULL));
    lg_detector_data_destroy(&data);
    lg_scaler_destroy(&scaler);
    REFUSES(lg_metrics_auc(NULL, NEEDED(label), NEEDED(x), 12, 2, NEEDED(others)));
    lg_features_destroy(&features);
    lg_tree_destroy(&tree);
    lg_svm_destroy(&svm);
    lg_windows_destroy(&windows);
    lg_series_destroy(&series);
}

static lg_status run_trial(void *user, lg_search *search, lg_trial *trial, lg_error *why) {
    trial->objective = 1.0;
    return LG_OK;
}

static lg_status gather(void *user, void *all, const size_t *bytes) {
    return LG_OK;
}

TEST("functions of risers, searches and ranks refuse NULL") {
    lg_riser_parameters riser;
    lg_riser_run run;
    uint32_t label, sea_state;
    lg_riser_standard_run(0, 1, 1.0, &riser, &run, &label, &sea_state);
    run.discard = run.ramp = 0.0;
    float samples[LG_RISER_CHANNELS];
    REFUSES(lg_riser_parameters_check(NEEDED(&riser), NULL));
    REFUSES(lg_riser_simulate(NULL, NEEDED(&riser), NEEDED(&run), 1, NEEDED(samples), NULL));

    const lg_search_space space = {.count = 1, .ranges = {{.name = "lr", .low = 1.0, .high = 2.0}}};
    const lg_search_problem problem = {.run = run_trial};
    lg_search_options options;
    lg_search_options_init(&options);
    lg_trial trial = {0};
    REFUSES(lg_search_space_check(NEEDED(&space), NULL));
    REFUSES(lg_search_run_trial(NEEDED(&space), NEEDED(&options), NEEDED(&problem), NULL, 0, NEEDED(&trial),
                                NULL));

    const lg_ranks ranks = {sizeof ranks, 0, 1, NULL, gather, NULL, NULL};
    lg_context *context;
    lg_hamiltonian_run hyper;
    REFUSES(lg_ranks_share(NEEDED(&ranks), 0, NEEDED(others), 8));
    REFUSES(lg_ranks_agree(NEEDED(&ranks), LG_OK, NULL));
    REFUSES(lg_context_create(NULL, NEEDED(&context)));
    lg_fields_default(lg_hamiltonian_fields, &hyper);
    REFUSES(lg_field_set(NEEDED(lg_field_find(lg_hamiltonian_fields, "epochs")), NEEDED("3"), NEEDED(&hyper),
                         NULL));
}

TEST("functions of machines refuse NULL") {
    static const char text[] = "coordinates: [{name: x, kind: line, velocity: vx}]\n"
                               "mass: {kind: diagonal}\n"
                               "potential: {kind: polynomial, of: x, degree: 2}\n";
    lg_machine_model_file *file = make_machine_model(text, 1);
    lg_machine *machine = &file->run.machine, changed = *machine, grey = {.coordinate_count = 2};
    const double *theta = file->theta;
    enum { ROWS = 8 };
    double t[ROWS], q[ROWS], v[ROWS];
    for (int i = 0; i < ROWS; i++) t[i] = 0.1 * i, q[i] = cos(t[i]), v[i] = -sin(t[i]);
    const size_t first[2] = {0, ROWS}, start[2] = {0, 3};
    lg_machine_problem problem = {.machine = machine,
                                  .scheme = lg_scheme_find("cf4"),
                                  .substeps = 1,
                                  .window = 4,
                                  .log = {ROWS, 1, first, t, q, v, NULL, NULL, NULL, NULL},
                                  .windows = 2,
                                  .start = start,
                                  .position_scale = {1.0},
                                  .velocity_scale = {1.0}};
    lg_space space;
    lg_tape *tape = test_tape(LG_F64);
    const lg_var at = lg_input(tape, lg_shape1((uint32_t)machine->parameters), theta);
    const lg_var one = lg_full(tape, lg_shape2(1, 1), 1.0);
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS], out[LG_TAPED_MAX_PARTS];
    assert_ok(lg_machine_bind(tape, machine, at, &vars));
    assert_ok(lg_machine_record_state(tape, &vars, one, one, parts));
    lg_identified *identified = TEST_ARRAY(lg_identified, 64);
    lg_identification about = {.numbers = identified};
    double *direction = TEST_ARRAY(double, machine->parameters), x[3];
    const lg_machine_restriction restriction = {&problem, theta, 1, direction};
    lg_machine_adapted adapted = {.x = x, .error = x + 1, .alone = x + 2};
    direction[0] = 0.1;
    lg_program *program;
    lg_machine_filter *filter;
    for (int i = 0; i < 2; i++)
        grey.coordinates[i] = (lg_machine_coordinate){.name = {(char)('p' + i)}, .kind = LG_COORDINATE_ANGLE};
    REFUSES(lg_machine_init(NEEDED(&changed), NULL));
    REFUSES(lg_machine_set_system(NEEDED(&grey), NEEDED("two-link-arm"), NULL));
    assert_ok(lg_machine_set_system(&grey, "two-link-arm", &error));
    REFUSES(lg_machine_set_parameter(NEEDED(&grey), NEEDED("gravity"), 1, NEEDED(numbers), NULL, NULL));
    assert_ok(lg_machine_set_parameter(&grey, "gravity", 1, &(double){1.5}, &(bool){true}, &error));
    REFUSES(lg_machine_bound_parameter(NEEDED(&grey), NEEDED("gravity"), 0, 1, 2, 0, NULL));
    REFUSES(lg_machine_space(NEEDED(machine), NEEDED(&space)));
    REFUSES(lg_machine_full_space(NEEDED(machine), NEEDED(&space)));
    REFUSES(lg_machine_filter_create(NULL, NEEDED(machine), NEEDED(&problem.log), NEEDED(&filter), NULL));
    REFUSES(lg_machine_lagged_inputs(NULL, NEEDED(machine), NEEDED(theta), NEEDED(&problem.log),
                                     NEEDED(start), 2, NEEDED(others), NULL));
    REFUSES(lg_machine_bind(NEEDED(tape), NEEDED(machine), at, NEEDED(&vars)));
    REFUSES(lg_machine_record_state(NEEDED(tape), NEEDED(&vars), one, one, NEEDED(parts)));
    REFUSES(lg_machine_record_field(NEEDED(tape), NEEDED(&vars), NEEDED(parts), LG_NONE, NEEDED(out)));
    REFUSES(lg_machine_find_scales(NEEDED(&changed), NEEDED(&problem.log), NULL));
    REFUSES(lg_machine_rest_rate(NULL, NEEDED(machine), theta, NEEDED(&problem.log), NEEDED(others), NULL));
    REFUSES(lg_machine_problem_check(NEEDED(&problem), NULL));
    REFUSES(lg_machine_loss(NULL, NEEDED(&problem), NEEDED(theta), NEEDED(others), NULL, NULL));
    REFUSES(lg_machine_identify(NULL, NEEDED(&problem), NEEDED(theta), NEEDED(&about), NULL));
    REFUSES(lg_machine_adapt(NULL, NEEDED(&restriction), NEEDED(&adapted), NULL));
    REFUSES(lg_machine_free_run(NULL, NEEDED(machine), NEEDED(theta), NEEDED(problem.scheme), 1,
                                NEEDED(&problem.log), NEEDED(start), 2, 2, NULL, NULL, NULL));
    REFUSES(lg_machine_estimate_starts(NULL, NEEDED(machine), NEEDED(theta), NEEDED(problem.scheme), 1,
                                       NEEDED(&problem.log), NEEDED(start), 2, 4, NEEDED(others),
                                       NEEDED(others + 8), NULL));
    REFUSES(lg_machine_program(NULL, NEEDED(machine), NEEDED(theta), NULL, false, NEEDED(&program), NULL));
    REFUSES(lg_recipe_save(NULL, NEEDED("/nonexistent/file.h5"), NEEDED(&lg_recipe_machine_model),
                           NEEDED(file), NULL, NULL));
}

/* x' = (w, u - x): a spring and a mass. */
static lg_status spring_field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_var q = lg_slice(tape, x[0], 1, 0, 1), w = lg_slice(tape, x[0], 1, 1, 1);
    (void)user, (void)theta;
    y[0] = lg_concat(tape, (lg_var[]){w, lg_sub(tape, x[1], q)}, 2, 1);
    return lg_tape_status(tape);
}

static lg_status spring_rate(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_var u = lg_scale(tape, lg_slice(tape, x[0], 1, 1, 1), -1.0);
    return spring_field(user, tape, theta, (const lg_var[]){x[0], u}, y);
}

static lg_status spring_slope(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user, (void)theta;
    y[0] = lg_scale(tape, x[0], 1.0);
    return lg_tape_status(tape);
}

static lg_program *spring(void) {
    static lg_port in[2] = {{.name = "x", .shape = {1, {2, 0, 0, 0}}},
                            {.name = "u", .shape = {1, {1, 0, 0, 0}}}},
                   one = {.name = "q", .shape = {1, {1, 0, 0, 0}}}, out = {.name = "y"};
    const lg_function_spec functions[] = {{"field", in, 2, &out, 1, spring_field, NULL},
                                          {"rate", in, 1, &out, 1, spring_rate, NULL},
                                          {"slope", &one, 1, &out, 1, spring_slope, NULL}};
    lg_program_spec spec;
    lg_program *program;
    lg_space space;
    lg_program_spec_init(&spec);
    spec.functions = functions, spec.function_count = LG_COUNT(functions);
    assert_ok(lg_program_build(NULL, &spec, &program, &error));
    assert_ok(lg_space_init_rn(&space, 2));
    assert_ok(lg_program_add_step(program, &space, lg_scheme_find("rk4"), 0.01, 0.1, &error));
    return program;
}

TEST("bounds and certificates refuse NULL") {
    static const double P[4] = {2, 0.1, 0.1, 2}, low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    lg_program *program = spring();
    const size_t first = 1;
    lg_interval *interval;
    lg_certify *certify;
    lg_certify_spec spec;
    lg_certify_energy_spec energy;
    lg_lyapunov_spec lyapunov;
    lg_certify_result result;
    lg_certify_energy_result found;
    lg_certify_attitude_result attitude;
    lg_certify_rotation_spec turn;
    lg_certify_rotation_result turned;
    lg_lyapunov_search search;
    double form[4];
    assert_ok(lg_interval_create(program, &first, 1, NULL, &interval, &error));
    void *room = lg_test_memory(lg_interval_work_size(interval));
    REFUSES(lg_interval_create(NEEDED(program), NEEDED(&first), 1, NULL, NEEDED(&interval), NULL));
    lg_interval_taylor_spec taylor;
    lg_interval_taylor_spec_init(&taylor);
    REFUSES(lg_interval_taylor(NEEDED(program), NEEDED(&taylor), NULL, NEEDED(&interval), NULL));
    REFUSES(
        lg_interval_rounding(NEEDED(program), 0, NEEDED(low), NEEDED(high), 0x1p-53, NEEDED(numbers), NULL));
    REFUSES(lg_interval_eval(NEEDED(interval), 1, NEEDED(low), NEEDED(high), NEEDED(numbers), NEEDED(others),
                             NULL, NEEDED(room), NULL));
    lg_certify_spec_init(&spec);
    spec.program = program, spec.rate = "rate", spec.P = P, spec.low = low, spec.high = high;
    assert_ok(lg_certify_create(NULL, &spec, &certify, &error));
    REFUSES(lg_certify_create(NULL, NEEDED(&spec), NEEDED(&certify), NULL));
    REFUSES(lg_certify_run(NEEDED(certify), 1, 1, NEEDED(&result), NULL));
    lg_certificate file = {.context = NULL};
    bool same[2];
    assert_ok(lg_certify_run(certify, SIZE_MAX, 10, &result, &error));
    REFUSES(lg_certificate_make(NULL, NEEDED(&spec), NEEDED(&result), 1, NEEDED(&file), NULL));
    assert_ok(lg_certificate_make(NULL, &spec, &result, 1, &file, &error));
    (void)snprintf(file.plant, sizeof file.plant, "plant");
    (void)snprintf(file.controller, sizeof file.controller, "controller");
    REFUSES(lg_certify_open(NULL, NEEDED(&file), 1, NEEDED(&certify), NULL));
    REFUSES(lg_certificate_compare(NEEDED(&file), NEEDED(program), NEEDED("rate"), NEEDED("rate"),
                                   NEEDED(&same[0]), NEEDED(&same[1]), NULL));
    REFUSES(lg_certificate_save(NULL, NEEDED("/no/such.json"), NEEDED(&file), NULL));
    REFUSES(lg_certificate_load(NULL, NEEDED("/no/such.json"), NEEDED(&file), NULL));
    lg_certificate_destroy(NULL);
    lg_certificate_destroy(&file);
    lg_certify_energy_spec_init(&energy);
    energy.program = program, energy.slope = "slope", energy.damping = 1, energy.gain = 1,
    energy.saturated = 1, energy.period = 1;
    REFUSES(lg_certify_energy(NULL, NEEDED(&energy), NEEDED(&found), NULL));
    REFUSES(lg_certify_attitude(NEEDED(((double[]){1, 0, 0, 0, 1, 0, 0, 0, 1})), 1, NEEDED(&attitude), NULL));
    lg_certify_rotation_spec_init(&turn);
    turn.J[0] = turn.J[4] = turn.J[8] = turn.stiffness = turn.damping = turn.limit[0] = 1, turn.inputs = 1;
    REFUSES(lg_certify_rotation(NEEDED(&turn), NEEDED(&turned), NULL));
    lg_lyapunov_search_init(&search);
    search.rate = "rate", search.low = low, search.high = high, search.generations = 2;
    REFUSES(lg_lyapunov_quadratic(NULL, NEEDED(program), NEEDED(&search), NEEDED(form), NULL, NULL, NULL));
    lg_lyapunov_spec_init(&lyapunov);
    lyapunov.rate = "rate", lyapunov.name = "V", lyapunov.low = low, lyapunov.high = high,
    lyapunov.degree = 2, lyapunov.points = 100;
    REFUSES(lg_lyapunov_polynomial(NEEDED(program), NEEDED(&lyapunov), NULL));
    lg_certify_destroy(certify);
    lg_interval_destroy(interval);
    lg_program_destroy(program);
}

static lg_policy_task spring_task(void) {
    lg_policy_task task;
    lg_policy_task_init(&task);
    task.kind = LG_POLICY_LQR;
    task.coordinate_count = 2, task.input_count = 1;
    for (int i = 0; i < 2; i++)
        task.coordinate[i] = (lg_policy_coordinate){
            .name = {(char)('a' + i)}, .start = {-1, 1}, .weight = 1, .success = 0.1, .success_velocity = 1};
    task.input[0] = (lg_policy_input){"u", -2, 2, 0.1};
    return task;
}

TEST("policies refuse NULL") {
    memory_archive *archive = TEST_ARRAY(memory_archive, 1);
    const lg_archive_writer writer = memory_writer(archive);
    const lg_archive_reader reader = memory_reader(archive);
    const lg_policy_task task = spring_task();
    lg_policy_task rough = task;
    lg_policy *policy, *other;
    lg_policy_turn turn;
    double ratio[1] = {1};
    lg_policy_trainer *trainer;
    lg_policy_outcome outcome;
    lg_policy_gap gap;
    lg_program *program;
    lg_policy_slope energy;
    assert_ok(lg_policy_create(NULL, &task, spring(), 1, &policy, &error));
    REFUSES(lg_policy_create(NULL, NEEDED(&task), NEEDED(spring()), 1, NEEDED(&other), NULL));
    REFUSES(lg_policy_transplant(NEEDED(policy), NULL, NULL, NEEDED(&other), NULL));
    REFUSES(lg_policy_add_rate(NEEDED(policy), NEEDED(&program), NULL));
    assert_status(lg_policy_find_turn(NULL, &turn, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_find_turn(policy, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_bound_gate(NULL, ratio, 1, ratio, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_bound_gate(policy, NULL, 1, ratio, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_bound_gate(policy, ratio, 1, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_add_slope(NULL, &energy, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_add_slope(policy, NULL, NULL), LG_INVALID_ARGUMENT);
    rough.delay = 0.5;
    REFUSES(lg_policy_disturb(NEEDED(policy), NEEDED(&rough), NULL));
    assert_ok(lg_policy_disturb(policy, &rough, &error));
    REFUSES(lg_policy_add_draw(NEEDED(policy), NEEDED(spring()), NULL));
    REFUSES(lg_policy_evaluate(NEEDED(policy), LG_POLICY_NOMINAL, 4, 1, 1, NEEDED(&outcome), NULL, NULL));
    REFUSES(lg_policy_find_gaps(NEEDED(policy), 1, 1, 0, NEEDED(&gap), NULL, NULL));
    REFUSES(lg_policy_trainer_create(NEEDED(policy), NULL, NEEDED(&trainer), NULL));
    assert_ok(lg_policy_trainer_create(policy, NULL, &trainer, &error));
    REFUSES(lg_policy_trainer_run(NEEDED(trainer), NULL, NULL));
    REFUSES(lg_policy_trainer_save(NEEDED(trainer), NEEDED(&writer), NULL));
    assert_ok(lg_policy_trainer_save(trainer, &writer, &error));
    REFUSES(lg_policy_trainer_load(NEEDED(trainer), NEEDED(&reader), NULL));
    lg_policy_trainer_destroy(trainer);
    lg_policy_destroy(policy);
}

/* Functions that the tests above leave out: they have no pointers, need MPI, or need more than a few lines of
 * files. */
static const char *const left_out[] = {
    "lg_minimise_end_status",
    "lg_mpi_begin",
    "lg_mpi_end",
    "lg_file_writer_archive",
    "lg_file_writer_commit",
    "lg_rows_file_create",
    "lg_rows_file_put",
    "lg_rows_file_commit",
    "lg_file_writer_rows",
    "lg_file_reader_archive",
    "lg_hamiltonian_save_errors",
    "lg_elastica_data_write",
    "lg_series_write",
    "lg_checkpoint_create",
    "lg_checkpoint_open",
    "lg_recipe_compare_runs",
    "lg_model_file_program",
    "lg_trials_write",
    "lg_trials_read",
    "lg_scene_draw_start",
    "lg_logs_read",
    "lg_table_evidence",
    "lg_table_keep_complete",
    "lg_policy_task_read",
    "lg_policy_task_parse",
    "lg_policy_save",
    "lg_policy_load",
    "lg_policy_add_slope",
    "lg_policy_find_turn",
    "lg_policy_bound_gate",
};

static bool is_called(const char *name, size_t length) {
    for (size_t i = 0; i < call_count; i++)
        if (strncmp(calls[i], name, length) == 0 && calls[i][length] == '(') return true;
    return false;
}

static bool is_left_out(const char *name, size_t length) {
    for (size_t i = 0; i < LG_COUNT(left_out); i++)
        if (strlen(left_out[i]) == length && memcmp(left_out[i], name, length) == 0) return true;
    return false;
}

/* This must be the last test, because it uses the calls that the other tests recorded. */
TEST("every public function that returns an lg_status is called above, or listed as left out") {
    static const char begin[] = "\nLG_API lg_status ";
    glob_t headers;
    size_t found = 0; /* number of entries of left_out */
    assert_int_equal(glob(LG_TEST_DIR "/../include/liegrad/*.h", 0, NULL, &headers), 0);
    for (size_t i = 0; i < headers.gl_pathc; i++) {
        static char text[1 << 17];
        FILE *file = fopen(headers.gl_pathv[i], "rb");
        assert_non_null(file);
        text[fread(text, 1, sizeof text - 1, file)] = '\0';
        assert_true(feof(file));
        (void)fclose(file);
        for (const char *at = text; (at = strstr(at, begin)) != NULL;) {
            at += sizeof begin - 1;
            const size_t length = strcspn(at, "(\n");
            found += is_left_out(at, length);
            if (is_called(at, length) == is_left_out(at, length)) {
                print_error("ERROR: %.*s: neither called nor left out, or both\n", (int)length, at);
                faults++;
            }
        }
    }
    globfree(&headers);
    assert_int_equal(found, LG_COUNT(left_out));
}
