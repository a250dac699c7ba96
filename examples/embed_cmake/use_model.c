/* use_model MODEL.h5 [CALLS]: loads any trained model and uses it as a control loop would. It computes values
 * and Jacobians, and for models that move also the field, the linearisation and integrator steps. It prints
 * microseconds per call. The exit code is 1 if a result is not finite, if the Jacobian is not the derivative
 * of the value, or if a step leaves the manifold. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include <liegrad/hamiltonian.h>
#include <liegrad/model.h>

/* Everything that the loops use, allocated before them. */
typedef struct session {
    const lg_model *model;
    int chain;     /* the model is a Hamiltonian of pendulum chains: its states lie on a manifold */
    int conserved; /* energy is conserved without an input: true for Hamiltonians; machines are damped */
    size_t inputs, outputs, calls;
    double *x, *dx, *y, *near, *jacobian;
    void *work;
    int failed;
} session;

static double now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Returns zeroed, 64-byte aligned memory. */
static void *reserve(size_t bytes) {
    const size_t whole = (bytes + 63) / 64 * 64 + 64;
    char *memory = aligned_alloc(64, whole);
    if (memory == NULL) {
        (void)fputs("out of memory\n", stderr);
        exit(5);
    }
    for (size_t i = 0; i < whole; i++) memory[i] = 0;
    return memory;
}

static void check(session *self, int good, const char *what) {
    if (!good) (void)fprintf(stderr, "FAILED: %s\n", what);
    self->failed |= !good;
}

static int all_finite(const double *x, size_t n) {
    for (size_t i = 0; i < n; i++)
        if (!isfinite(x[i])) return 0;
    return 1;
}

/* Fills an input of the right kind and size; `phase` varies it. liegrad/model.h says what the numbers
 * mean. */
static void fill_input(const session *self, double *x, double phase) {
    for (size_t i = 0; i < self->inputs; i++) x[i] = 0.3 * sin(1.0 + (double)i + phase);
    if (!self->chain) return;
    for (size_t l = 0; l < self->inputs; l += 6) { /* per link: q with |q| = 1, and p with q.p = 0 */
        double length = 0.0, along = 0.0;
        x[l + 2] -= 1.0;
        for (size_t i = l; i < l + 3; i++) length += x[i] * x[i];
        for (size_t i = l; i < l + 3; i++) x[i] /= sqrt(length);
        for (size_t i = l; i < l + 3; i++) along += x[i] * x[i + 3];
        for (size_t i = l; i < l + 3; i++) x[i + 3] -= along * x[i];
    }
}

/* Compares J dx with (y(x + e dx) - y(x - e dx))/2e. For chains dx is tangent to the manifold. */
static void check_jacobian(session *self) {
    const double e = 1e-5;
    double worst = 0.0, size = 1e-3;
    fill_input(self, self->x, 0.0);
    lg_model_jacobian(self->model, self->x, NULL, self->jacobian, self->work);
    fill_input(self, self->dx, e);
    lg_model_eval(self->model, self->dx, self->y, self->work);
    fill_input(self, self->near, -e);
    for (size_t i = 0; i < self->inputs; i++) self->dx[i] -= self->near[i];
    double *low = reserve(self->outputs * sizeof *low);
    lg_model_eval(self->model, self->near, low, self->work);
    for (size_t o = 0; o < self->outputs; o++) {
        double sum = 0.0;
        for (size_t i = 0; i < self->inputs; i++) sum += self->jacobian[o * self->inputs + i] * self->dx[i];
        worst = fmax(worst, fabs(sum - (self->y[o] - low[o])));
        size = fmax(size, fabs(sum) / (2.0 * e));
    }
    free(low);
    (void)printf("Jacobian against a difference quotient: %.1e\n", worst / (2.0 * e) / size);
    check(self, worst / (2.0 * e) <= 1e-5 * size, "the Jacobian is not the derivative");
}

static void print_time(const char *what, double seconds, size_t calls) {
    (void)printf("%-14s %10.3f us\n", what, 1e6 * seconds / (double)calls);
}

static void evaluate(session *self) {
    double begin = now();
    for (size_t n = 0; n < self->calls; n++) {
        self->x[n % self->inputs] *= 0.999;
        lg_model_eval(self->model, self->x, self->y, self->work);
    }
    print_time("eval", now() - begin, self->calls);
    check(self, all_finite(self->y, self->outputs), "a value is not finite");
    begin = now();
    for (size_t n = 0; n < self->calls; n++) {
        self->x[n % self->inputs] *= 0.999;
        lg_model_jacobian(self->model, self->x, self->y, self->jacobian, self->work);
    }
    print_time("jacobian", now() - begin, self->calls);
    check(self, all_finite(self->jacobian, self->outputs * self->inputs), "a derivative is not finite");
}

static void linearise(session *self) {
    const size_t r = lg_model_tangent_dim(self->model), m = lg_model_input_dim(self->model);
    double *A = reserve(r * r * sizeof *A), *B = reserve(r * m * sizeof *B),
           *basis = reserve(self->inputs * r * sizeof *basis);
    lg_status status = LG_OK;
    fill_input(self, self->x, 0.0);
    const double begin = now();
    for (size_t n = 0; n < self->calls && status == LG_OK; n++)
        status = lg_model_linearise(self->model, self->x, NULL, A, B, basis, self->work);
    print_time("linearise", now() - begin, self->calls);
    check(self, status == LG_OK && all_finite(A, r * r) && all_finite(B, r * m), "the linearisation failed");
    free(A);
    free(B);
    free(basis);
}

static double off_manifold(const session *self, const double *y) {
    double worst = 0.0;
    if (!self->chain) return 0.0;
    for (size_t l = 0; l < self->inputs; l += 6) {
        const double *q = y + l, *p = q + 3;
        worst = fmax(worst, fabs(sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]) - 1.0));
        worst = fmax(worst, fabs(q[0] * p[0] + q[1] * p[1] + q[2] * p[2]));
    }
    return worst;
}

/* Integrates the learned system without input on its manifold, and checks that energy and manifold are
 * kept. */
static void predict(session *self) {
    const lg_scheme *scheme = lg_scheme_find("cf4");
    const size_t bytes = lg_model_stepper_size(self->model, scheme);
    void *memory = reserve(bytes);
    double *input = reserve(lg_model_input_dim(self->model) * sizeof *input), energy[2], worst = 0.0;
    lg_stepper *stepper;
    lg_status status = lg_model_stepper_init(self->model, scheme, &stepper, memory, bytes);
    fill_input(self, self->x, 0.0);
    lg_model_eval(self->model, self->x, energy, self->work);
    double begin = now();
    for (size_t n = 0; n < self->calls && status == LG_OK; n++)
        status = lg_stepper_step(stepper, 0.0, 1e-3, self->x, input, self->x);
    print_time("step", now() - begin, self->calls);
    check(self, status == LG_OK, "a step failed");
    worst = off_manifold(self, self->x);
    lg_model_eval(self->model, self->x, energy + 1, self->work);
    (void)printf("after %zu steps of %s: energy changed by %.1e, off the manifold by %.1e\n", self->calls,
                 scheme->name, energy[1] - energy[0], worst);
    const int kept = fabs(energy[1] - energy[0]) <= 1e-6 * (1.0 + fabs(energy[0]));
    check(self, (kept || !self->conserved) && worst <= 1e-12, "steps do not keep energy and manifold");
    double *field = reserve(self->inputs * sizeof *field);
    begin = now();
    for (size_t n = 0; n < self->calls && status == LG_OK; n++)
        status = lg_model_field(self->model, self->x, input, field, self->work);
    print_time("field", now() - begin, self->calls);
    check(self, status == LG_OK && all_finite(field, self->inputs), "a field failed");
    free(field);
    free(input);
    free(memory);
}

int main(int argc, char **argv) {
    lg_model_file file;
    lg_error error;
    uint64_t calls = 1000;
    if (argc < 2 || argc > 3 ||
        (argc == 3 && (lg_integer_parse(argv[2], &calls) != LG_OK || calls == 0 || calls > 1000000000))) {
        (void)fputs("usage: use_model MODEL.h5 [CALLS, 1 to 1000000000]\n", stderr);
        return 2;
    }
    if (lg_model_load(NULL, argv[1], NULL, &file, &error) != LG_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        return 3;
    }
    const lg_model *model = file.model;
    const lg_hamiltonian_file *hamiltonian = lg_model_file_of(&file, &lg_recipe_hamiltonian);
    session self = {.model = model,
                    .chain = hamiltonian != NULL &&
                             hamiltonian->run.model.family == lg_hamiltonian_family_find("chain"),
                    .conserved = hamiltonian != NULL,
                    .inputs = lg_model_inputs(model),
                    .outputs = lg_model_outputs(model),
                    .calls = (size_t)calls};
    self.work = reserve(lg_model_work_size(model));
    self.x = reserve(self.inputs * sizeof *self.x);
    self.dx = reserve(self.inputs * sizeof *self.dx);
    self.near = reserve(self.inputs * sizeof *self.near);
    self.y = reserve(self.outputs * sizeof *self.y);
    self.jacobian = reserve(self.inputs * self.outputs * sizeof *self.jacobian);
    (void)printf("%zu inputs, %zu outputs, %zu parameters, %zu bytes of work\n", self.inputs, self.outputs,
                 lg_model_parameters(model), lg_model_work_size(model));
    check_jacobian(&self);
    evaluate(&self);
    if (lg_model_tangent_dim(model) > 0) {
        linearise(&self);
        predict(&self);
    }
    free(self.work);
    free(self.x);
    free(self.dx);
    free(self.near);
    free(self.y);
    free(self.jacobian);
    lg_model_file_destroy(&file);
    return self.failed;
}
