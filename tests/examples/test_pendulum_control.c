/* examples/pendulum_control: the control laws, and a whole run without allocation. The learned model has a
 * linear potential V = w.q, whose parameters are known. */
#include "support/models.h"
#include "test_support.h"

#include <unistd.h>

#include "../../examples/pendulum_control/controller.c"
#include "../../examples/pendulum_control/latency.c"
#include "../../examples/pendulum_control/plots.c"
#include "../../examples/pendulum_control/plant.c"
#include "../../examples/pendulum_control/trial.c"
#include "support/malloc_count.h"

/* ---- controller ---- */

typedef struct fixture {
    lg_model *model; /* w, Gamma, b */
    void *work;
    controller control;
    char why[256];
} fixture;

static void release(void *of) {
    lg_model_destroy(((fixture *)of)->model);
}

/* `fits` false: the model must be refused, and `why` gets the reason. */
static fixture *make(const double *w, double mass, double torque_max, bool fits) {
    const double theta[5] = {w[0], w[1], w[2], sqrt(mass), -1.0};
    lg_hamiltonian learned;
    fixture *self = TEST_ARRAY(fixture, 1);
    assert_ok(lg_hamiltonian_init(&learned, lg_hamiltonian_family_find("chain"), 1, LG_POTENTIAL_LINEAR, NULL,
                                  0, LG_TANH));
    assert_int_equal(lg_hamiltonian_parameters(&learned), 5);
    assert_ok(test_hamiltonian_model(NULL, &learned, theta, &self->model, NULL));
    lg_test_owns(self, release);
    self->work = lg_test_memory(controller_work_size(self->model));
    assert_int_equal(controller_init(&self->control, self->model, self->work, torque_max, self->why), fits);
    return self;
}

RELEASES(release_plant, plant_destroy)

static plant *make_plant(void) {
    plant *truth = TEST_ARRAY(plant, 1);
    assert_true(plant_create(truth));
    lg_test_owns(truth, release_plant);
    return truth;
}

/* V = w.q: upright is along w, m g L = |w|; a'' = |w|/m a + u/m in both directions, so the unstable rate is
 * sqrt(|w|/m). */
TEST("a controller can be designed for a tilted potential") {
    const double w[3] = {0.3, -0.2, 2.0}, mass = 0.5, size = norm(w);
    fixture *self = make(w, mass, 0.7, true);
    const controller *c = &self->control;
    for (int i = 0; i < 3; i++) assert_close(c->upright[i], w[i] / size, 0.0, 1e-14);
    assert_close(c->energy_scale, size, 1e-14, 0.0);
    assert_close(c->energy_up, size, 1e-14, 0.0);
    assert_close(c->mass, mass, 1e-14, 0.0);
    for (int j = 0; j < 2; j++) {
        assert_close(c->lqr.A[(2 + j) * TANGENT + j], size, 1e-13, 0.0);
        assert_close(c->lqr.A[j * TANGENT + 2 + j], 1.0 / mass, 1e-13, 0.0);
    }
    /* Torques along the link have no effect. The gain is orthogonal to the link, and larger than needed to
     * hold the unstable equilibrium. */
    for (int j = 0; j < TANGENT; j++) {
        double along = 0.0, across = 0.0;
        for (int i = 0; i < TORQUE; i++) {
            along += c->upright[i] * c->lqr.K[i * TANGENT + j];
            across += c->lqr.K[i * TANGENT + j] * c->lqr.K[i * TANGENT + j];
        }
        assert_close(along, 0.0, 0.0, 1e-12);
        assert_true(j >= 2 || sqrt(across) > 1.5 * size);
    }
}

TEST("models that cannot be balanced are refused with a message") {
    const double sideways[3] = {1.0, 0.0, 0.1}, below[3] = {0.01, 0.0, -1.0}, huge[3] = {0.0, 0.0, 1e308};
    const double *const cases[] = {sideways, below, huge}; /* huge: m g L overflows */
    for (size_t i = 0; i < 3; i++) {
        const fixture *self = make(cases[i], 1.0, 0.35, false);
        assert_true(strlen(self->why) > 10);
    }
}

/* A random state: anywhere, or near upright. */
static void draw_state(lg_rng *rng, bool near, double *y) {
    double q[3], p[3], along = 0.0;
    for (int i = 0; i < 3; i++) q[i] = lg_rng_normal(rng) * (near ? 0.1 : 1.0) + (near && i == 2 ? 1.0 : 0.0);
    for (int i = 0; i < 3; i++) p[i] = lg_rng_normal(rng) * (near ? 0.1 : 1.0);
    const double length = norm(q);
    for (int i = 0; i < 3; i++) y[i] = q[i] / length;
    for (int i = 0; i < 3; i++) along += y[i] * p[i];
    for (int i = 0; i < 3; i++) y[3 + i] = p[i] - y[i] * along;
}

/* While swinging up, W = (H - 1)^2/2 + L^2/2 of the true pendulum must fall whenever the torque is more than
 * rounding. While balancing, c^T P c must fall. Both over one control period. */
TEST("Lyapunov functions fall while swinging up and while balancing") {
    const double w[3] = {0.0, 0.0, 1.0};
    int swings = 0, balances = 0;
    fixture *self = make(w, 1.0, 0.35, true);
    plant *truth = make_plant();
    lg_rng rng = test_rng(9, 0);
    for (int n = 0; n < 4000; n++) {
        double y[6], torque[3], before[2], after[2], c[4];
        draw_state(&rng, n % 2 == 0, y);
        self->control.mode = n % 4 < 2 ? SWING_UP : BALANCE;
        controller_step(&self->control, y, torque);
        assert_true(norm(torque) <= 0.35 * (1.0 + 1e-14));
        const double far = distance(&self->control, y, c);
        const double H = plant_energy(truth, y) - 1.0, L = y[0] * y[4] - y[1] * y[3];
        before[0] = 0.5 * (H * H + L * L), before[1] = far;
        assert_true((self->control.mode == BALANCE) ==
                    (far < self->control.region * (n % 4 < 2 ? catch_fraction : 1.0)));
        assert_true(plant_advance(truth, 1e-3, torque, y));
        const double H1 = plant_energy(truth, y) - 1.0, L1 = y[0] * y[4] - y[1] * y[3];
        after[0] = 0.5 * (H1 * H1 + L1 * L1), after[1] = distance(&self->control, y, c);
        if (self->control.mode == BALANCE) {
            assert_true(after[1] < before[1]);
            balances++;
        } else if (norm(torque) > 0.01 && before[0] > 1e-3) {
            assert_true(after[0] < before[0]);
            swings++;
        }
    }
    assert_true(swings > 1000 && balances > 300);
}

TEST("the power of the torque is the rate of change of the energy") {
    plant *truth = make_plant();
    const double torque[3] = {0.1, -0.05, 0.2};
    double y[6] = {0.6, 0.0, 0.8, 0.0, 0.3, 0.0}, power = 0.0, before, rate[3];
    const double q[3] = {0.6, 0.0, 0.8}, p[3] = {0.0, 0.3, 0.0};
    cross(q, p, rate); /* omega = q x q' */
    for (int i = 0; i < 3; i++) power += torque[i] * rate[i];
    before = plant_energy(truth, y);
    assert_true(plant_advance(truth, 1e-6, torque, y));
    assert_close((plant_energy(truth, y) - before) / 1e-6, power, 1e-4, 0.0);
}

TEST("a state that is not finite gives no torque") {
    const double w[3] = {0.0, 0.0, 1.0};
    fixture *self = make(w, 1.0, 0.35, true);
    for (int i = 0; i < 6; i++) {
        double y[6] = {0.0, 0.0, 1.0, 0.01, 0.0, 0.0}, torque[3] = {9.0, 9.0, 9.0};
        y[i] = NAN;
        controller_step(&self->control, y, torque);
        for (int j = 0; j < 3; j++) assert_close(torque[j], 0.0, 0.0, 0.0);
    }
}

typedef struct run {
    trial_times times;
    trace record;
    trial_result result;
} run;

enum { STEPS = 30000, TIMED = 20, ROWS = 100 };

/* Starts hanging at rest; some steps wait for the clock. */
static void run_counted(plant *truth, controller *control, run *r, lg_counts *used) {
    const trial_options options = {1e-3, 30.0, 5.0, 1e-2, 0.02};
    double y[6];
    r->times.paced.count = r->times.unpaced.count = r->times.wake.count = r->times.response.count =
        r->record.count = 0;
    assert_string_equal(trial_start(truth, 1, 0, y), "hanging at rest");
    lg_count_begin();
    r->result = trial_run(&options, truth, control, y, &r->times, &r->record);
    *used = lg_count_end();
}

/* The potential is slightly tilted, as a learned one is. */
TEST("a run allocates nothing, takes no lock, catches and holds the pendulum") {
    const double w[3] = {1e-3, -1e-3, 0.998};
    fixture *self = make(w, 1.001, 0.35, true);
    plant *truth = make_plant();
    run r = {{{malloc(STEPS * sizeof(int64_t)), 0, STEPS},
              {malloc(STEPS * sizeof(int64_t)), 0, STEPS},
              {malloc(TIMED * sizeof(int64_t)), 0, TIMED},
              {malloc(TIMED * sizeof(int64_t)), 0, TIMED}},
             {malloc(ROWS * sizeof(trace_row)), 0, ROWS, STEPS / ROWS},
             {0}};
    /* OpenBLAS's threads, which start with the process, each take a lock once, perhaps during the first
     * runs. */
    lg_counts used = {0, 0, 1};
    for (int attempt = 0; attempt < 5 && used.locks > 0; attempt++)
        run_counted(truth, &self->control, &r, &used);
    if (lg_count_available()) {
        assert_int_equal(used.allocations, 0);
        assert_int_equal(used.releases, 0);
        assert_int_equal(used.locks, 0);
    }
    assert_true(r.result.held && r.result.finite);
    assert_true(r.result.caught > 3.0 &&
                r.result.caught < 20.0); /* 2 m g L at a power of at most 0.35 |omega| needs some swings */
    assert_true(r.result.manifold < 1e-12);
    assert_close(r.result.most_torque, 0.35, 1e-12, 0.0);
    assert_int_equal(r.times.paced.count, TIMED);
    assert_int_equal(r.times.unpaced.count, STEPS - TIMED);
    assert_int_equal(r.times.wake.count, TIMED);
    assert_int_equal(r.times.response.count, TIMED);
    assert_int_equal(r.record.count, ROWS);
    for (size_t i = 0; i < TIMED; i++) {
        assert_true(r.times.wake.ns[i] >= 0); /* never early */
        assert_true(r.times.response.ns[i] >= r.times.wake.ns[i] + r.times.paced.ns[i]);
    }
    free(r.times.paced.ns);
    free(r.times.unpaced.ns);
    free(r.times.wake.ns);
    free(r.times.response.ns);
    free(r.record.rows);
}

TEST("latencies are summarised by their quantiles") {
    int64_t ns[2001];
    samples s = {ns, 0, 2001};
    assert_true(isnan(samples_summary(&s).median));
    for (int i = 2000; i >= 0; i--) samples_add(&s, 1000 * i);
    samples_add(&s, 1); /* no room */
    const latency l = samples_summary(&s);
    assert_int_equal(l.count, 2001);
    assert_close(l.median, 1000.0, 0.0, 1e-9);
    assert_close(l.p999, 1998.0, 0.0, 1e-9);
    assert_close(l.most, 2000.0, 0.0, 1e-9);
}

/* A row of the data counts the samples between its edge and the next edge. Each series contains all samples,
 * and the script draws from one edge to the next (gnuplot: steps). Nothing in the folder's name is
 * a command. */
TEST("the histogram counts each sample once, in its bin") {
    enum { EDGES = DECADES * DECADE_BINS + 1 };
    char folder[] = "/tmp/liegrad it's `touch RAN`$(touch RAN)\"|<XXXXXX", path[PATH], line[256];
    int64_t few[] = {1500, 1500, 1500, 990000}, ends[] = {0, 1000000000, 1, 200};
    const samples a = {few, 4, 4}, b = {ends, 4, 4};
    const histogram_series series[] = {{"a", &a}, {"b", &b}};
    double edge[2][EDGES], height[2][EDGES];
    assert_non_null(mkdtemp(folder));
    assert_true(plot_latency(folder, series, 2));
    (void)snprintf(path, sizeof path, "%s/latency.dat", folder);
    FILE *data = fopen(path, "r");
    assert_non_null(data);
    for (int s = 0, row = 0; fgets(line, sizeof line, data) != NULL && s < 2;) {
        if (sscanf(line, "%lf %lf", &edge[s][row], &height[s][row]) != 2) continue;
        if (++row == EDGES) row = 0, s++;
    }
    (void)fclose(data);
    for (int i = 0; i + 1 < EDGES; i++) {
        const bool has_a = edge[0][i] <= 1.5 && 1.5 < edge[0][i + 1],
                   has_b = edge[0][i] <= 990.0 && 990.0 < edge[0][i + 1];
        assert_close(height[0][i], has_a ? 0.75 : has_b ? 0.25 : 0.0, 0.0, 1e-8);
    }
    assert_close(height[1][0], 0.5, 0.0, 1e-8); /* samples outside the range count in the outermost bins */
    assert_close(height[1][EDGES - 2], 0.25, 0.0, 1e-8);
    assert_close(edge[0][EDGES - 1], 1e5, 1e-5, 0.0);
    (void)snprintf(path, sizeof path, "%s/latency.gp", folder);
    FILE *script = fopen(path, "r");
    assert_non_null(script);
    int steps = 0;
    while (fgets(line, sizeof line, script) != NULL)
        for (const char *at = line; (at = strstr(at, " with steps ")) != NULL; at++) steps++;
    (void)fclose(script);
    assert_int_equal(steps, 1); /* for each block */
    const bool drawn = system("command -v gnuplot >/dev/null") == 0;
    static const char *const made[] = {"latency.dat", "latency.gp", "latency.svg"};
    for (int i = 0; i < 3; i++) {
        (void)snprintf(path, sizeof path, "%s/%s", folder, made[i]);
        assert_int_equal(remove(path), i < 2 || drawn ? 0 : -1);
    }
    assert_int_equal(remove(folder), 0); /* it is empty */
    assert_int_equal(access("RAN", F_OK), -1);
}
