/* The table of systems: rows, layouts, parameters and their rules, fields of both forms, and what is refused
 * with which sentence. */
#include "system_check.h"

static const double gravity = 9.81, ones[3] = {1.0, 1.0, 1.0}, unlike[3] = {1.0, 1.3, 0.7};
static const lg_named_values only_gravity = {"gravity", &gravity, 1};

static lg_system_options chain_options(size_t links) {
    lg_system_options options;
    lg_system_options_init(&options);
    options.links = links;
    options.parameters = &only_gravity;
    options.parameter_count = 1;
    return options;
}

static void assert_layout(lg_system *system, const char *layout, size_t dim, size_t parameters) {
    assert_string_equal(lg_system_layout(system), layout);
    assert_int_equal(lg_system_dim(system), dim);
    assert_int_equal(lg_system_parameter_count(system), parameters);
}

TEST("every row of the table is complete and different") {
    const char *name = NULL, *form = NULL;
    size_t n = 0;
    for (; lg_system_at(n, &name, &form); n++) {
        assert_non_null(lg_system_parameters(name, form));
        const lg_state_entry *parts = lg_system_state(name, form);
        assert_non_null(parts);
        assert_non_null(parts[0].key);
        for (size_t i = 0; i < n; i++) {
            const char *other, *other_form;
            assert_true(lg_system_at(i, &other, &other_form));
            assert_true(strcmp(name, other) != 0 || strcmp(form, other_form) != 0);
        }
    }
    assert_true(n > 0);
    assert_false(lg_system_at(n, &name, &form));
    assert_true(lg_system_at(0, NULL, NULL));
    assert_null(lg_system_parameters("pendulum", NULL));
    assert_null(lg_system_state("oscillator", "lagrangian"));
    assert_null(lg_system_state(NULL, NULL));
    /* The first form is the one meant without a name. */
    assert_true(lg_system_state("pendulum-chain", NULL) == lg_system_state("pendulum-chain", "lagrangian"));
    assert_true(lg_system_state("pendulum-chain", NULL) != lg_system_state("pendulum-chain", "hamiltonian"));
}

TEST("layouts and sizes") {
    lg_system_options options = chain_options(2);
    assert_layout(make_system_with("pendulum-chain", &options), "q1 omega1 q2 omega2", 12, 5);
    options.form = "hamiltonian";
    assert_layout(make_system_with("pendulum-chain", &options), "q1 p1 q2 p2", 12, 5);
    assert_layout(make_system_with("oscillator", NULL), "q p", 2, 0);
    assert_layout(make_system_with("quartic", NULL), "q p", 4, 0);
    assert_layout(make_system_with("coupled-oscillators", NULL), "q p", 4, 0);
    options = chain_options(1000);
    lg_system *system = make_system_with("pendulum-chain", &options);
    const char *layout = lg_system_layout(system);
    assert_string_equal(layout + strlen(layout) - strlen(" q999 omega999 q1000 omega1000"),
                        " q999 omega999 q1000 omega1000");
}

TEST("parameters and labels are in the order of the table") {
    const lg_named_values given[] = {{"lengths", unlike, 3}, {"gravity", &gravity, 1}};
    const double expected[7] = {9.81, 1.0, 1.0, 1.0, 1.0, 1.3, 0.7};
    const char *const labels[8] = {"g", "m1", "m2", "m3", "L1", "L2", "L3", ""};
    char label[32];
    lg_system_options options = chain_options(3);
    options.parameters = given;
    options.parameter_count = 2;
    lg_system *system = make_system_with("pendulum-chain", &options);
    assert_string_equal(lg_system_name(system), "pendulum-chain");
    assert_string_equal(lg_system_form(system), "lagrangian");
    assert_int_equal(lg_system_links(system), 3);
    assert_int_equal(lg_system_reported(system), 18);
    assert_int_equal(lg_system_parameter_count(system), 7);
    assert_memory_equal(lg_system_parameter_values(system), expected, sizeof(expected));
    for (size_t i = 0; i < 8; i++) {
        lg_system_parameter_label(system, i, label);
        assert_string_equal(label, labels[i]);
    }
    options = chain_options(1);
    system = make_system_with("pendulum-chain", &options);
    lg_system_parameter_label(system, 1, label);
    assert_string_equal(label, "m1");
    system = make_system_with("oscillator", NULL);
    assert_null(lg_system_form(system));
    assert_int_equal(lg_system_links(system), 0);
}

/* status and words of the sentence, for one change of a good chain of three */
static void refused(const char *name, const lg_system_options *options, lg_status status, const char *first,
                    const char *second) {
    lg_system *system = NULL;
    lg_error error = {LG_OK, ""};
    assert_status(lg_system_create(NULL, name, options, &system, &error), status);
    assert_null(system);
    assert_int_equal(error.status, status);
    if (!strstr(error.message, first) || !strstr(error.message, second))
        fail_msg("\"%s\" lacks \"%s\" or \"%s\"", error.message, first, second);
    assert_status(lg_system_create(NULL, name, options, &system, NULL), status);
}

static void refused_values(const char *key, const double *values, size_t count, const char *first,
                           const char *second) {
    lg_system_options options = chain_options(3);
    const lg_named_values given[] = {{"gravity", &gravity, 1}, {key, values, count}};
    options.parameters = given;
    options.parameter_count = 2;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, first, second);
}

TEST("systems, forms and parameters that cannot be are refused by name") {
    const double bad[][3] = {{1.0, 0.0, 1.0}, {-1.0, 1.0, 1.0}, {1.0, 1.0, NAN}, {INFINITY, 1.0, 1.0}};
    static const char *const entry[4] = {"[1]", "[0]", "[2]", "[0]"};
    lg_system_options options = chain_options(3);
    refused("pendulum", &options, LG_NOT_FOUND, "\"pendulum\"", "oscillator, quartic");
    refused(NULL, &options, LG_NOT_FOUND, "there is no system", "pendulum-chain");
    options.form = "newtonian";
    refused("pendulum-chain", &options, LG_NOT_FOUND, "\"newtonian\"", "lagrangian, hamiltonian");
    refused("oscillator", &options, LG_NOT_FOUND, "\"newtonian\"", "one form only");
    for (int i = 0; i < 4; i++) {
        refused_values("masses", bad[i], 3, "masses", entry[i]);
        refused_values("lengths", bad[i], 3, "lengths", entry[i]);
    }
    refused_values("mass", ones, 3, "\"mass\"", "gravity, masses, lengths");
    refused_values(NULL, ones, 3, "no parameter", "gravity, masses, lengths");
    refused_values("gravity", &gravity, 1, "gravity", "twice");
    refused_values("masses", ones, 2, "2 numbers", "expected 3, one a link");
    refused_values("masses", ones, 1, "1 number given", "one a link");
    refused_values("masses", NULL, 3, "0 numbers", "masses");
    const lg_named_values two = {"gravity", ones, 2}, wild = {"gravity", bad[3], 1};
    options = chain_options(3);
    options.parameters = &two;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "2 numbers", "expected 1");
    options.parameters = &wild;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "gravity = inf", "not finite");
    options.parameters = NULL;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "parameters", "NULL");
    options.parameter_count = 0;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "\"gravity\"", "must be given");
    refused("pendulum-chain", NULL, LG_INVALID_ARGUMENT, "\"gravity\"", "must be given");
    options = chain_options(0);
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "links = 0", "1000000");
    options.links = 1000001;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "links", "1000000");
    options.links = SIZE_MAX;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "links", "1000000");
    options = chain_options(1);
    refused("oscillator", &options, LG_INVALID_ARGUMENT, "\"gravity\"", "none");
    options.size = 3;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "size", "3");
    assert_status(lg_system_create(NULL, "quartic", NULL, NULL, NULL), LG_INVALID_ARGUMENT);
    lg_system_destroy(NULL);
}

TEST("functions of chains refuse other systems and NULL") {
    lg_system *quartic = make_system_with("quartic", NULL);
    lg_system_options options = chain_options(1);
    lg_system *chain = make_system_with("pendulum-chain", &options);
    double x[36] = {0}, work[64];
    lg_system_user user;
    lg_ode ode;
    assert_status(lg_chain_mass_matrix(quartic, x), LG_UNSUPPORTED);
    assert_status(lg_chain_potential_weights(quartic, x), LG_UNSUPPORTED);
    assert_status(lg_chain_momenta(quartic, x, x, work), LG_UNSUPPORTED);
    assert_status(lg_chain_velocities(quartic, x, x, work), LG_UNSUPPORTED);
    assert_status(lg_chain_velocities(chain, x, x, work), LG_NOT_FINITE); /* links of length 0 */
    assert_status(lg_chain_momenta(chain, x, NULL, work), LG_INVALID_ARGUMENT);
    assert_status(lg_chain_gradient(quartic, x, x, x, work), LG_UNSUPPORTED);
    assert_status(lg_chain_gradient(chain, x, x, x, work), LG_UNSUPPORTED);
    assert_status(lg_chain_gradient(NULL, x, x, x, work), LG_INVALID_ARGUMENT);
    assert_status(lg_system_ode(quartic, (lg_coordinates)(LG_COORDINATES_AMBIENT + 1), &ode, &user, work),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_system_ode(NULL, LG_COORDINATES_LIE, &ode, &user, work), LG_INVALID_ARGUMENT);
    assert_status(lg_system_ode(quartic, LG_COORDINATES_LIE, &ode, NULL, work), LG_INVALID_ARGUMENT);
    assert_status(lg_system_ode(quartic, LG_COORDINATES_LIE, &ode, &user, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_system_ode(quartic, LG_COORDINATES_LIE, NULL, &user, work), LG_INVALID_ARGUMENT);
}

TEST("Figure 1.1's oscillator: the midpoint rule, H kept exactly") {
    lg_system *system = make_system_with("oscillator", NULL);
    double y[2] = {0.8, -0.6}, work[1], h = 0.3;
    lg_system_user user;
    lg_ode ode;
    assert_true(lg_system_separable(system) && !lg_system_constrained(system));
    assert_ok(lg_system_ode(system, LG_COORDINATES_AMBIENT, &ode, &user, work));
    for (int i = 0; i < 100; i++) {
        const double before[2] = {y[0], y[1]};
        double f[2];
        assert_ok(ode.step(&user, 0.0, h, y));
        assert_ok(
            ode.field(&user, 0.0, (double[]){0.5 * (y[0] + before[0]), 0.5 * (y[1] + before[1])}, NULL, f));
        for (int j = 0; j < 2; j++) assert_close(y[j], before[j] + h * f[j], 0.0, 1e-15);
    }
    assert_close(lg_system_hamiltonian(system, y, work), 0.5, 0.0, 1e-14);
    assert_int_equal(lg_system_invariants(system), 1);
}

TEST("a million links") {
    lg_system_options options = chain_options(1000000);
    lg_system *system = make_system_with("pendulum-chain", &options);
    assert_int_equal(lg_system_dim(system), 6000000);
    assert_int_equal(lg_system_parameter_count(system), 2000001);
}
