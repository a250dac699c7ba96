/* The table of systems: entries, layouts, parameters and their rules, and the messages for what is
 * refused. */
#include "mechanics/system_check.h"

static const double gravity = 9.81, ones[3] = {1.0, 1.0, 1.0}, unlike[3] = {1.0, 1.3, 0.7};
static const lg_named_values only_gravity = {"gravity", &gravity, 1}, unit_body = {"inertia", ones, 3},
                             two_masses = {"masses", ones, 2};

static lg_system_options options_of(const char *form, size_t links, const lg_named_values *given,
                                    size_t count) {
    lg_system_options options;
    lg_system_options_init(&options);
    options.form = form;
    if (links > 0) options.links = links;
    options.parameters = given;
    options.parameter_count = count;
    return options;
}

TEST("every system of the table is complete, and all differ") {
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
    /* Without a name the first form is used. */
    assert_true(lg_system_state("pendulum-chain", NULL) == lg_system_state("pendulum-chain", "lagrangian"));
    assert_true(lg_system_state("pendulum-chain", NULL) != lg_system_state("pendulum-chain", "hamiltonian"));
    assert_string_equal(lg_system_form(make_system("heavy-top", NULL, NULL, 0)), "cotangent");
}

static const char top_labels[] = "I1 I2 I3 m L chi1 chi2 chi3 gamma0_1 gamma0_2 gamma0_3",
                  quadrotor_labels[] = "J1 J2 J3 m_y m1 m2 L1 L2 g kx kv kq kw beta kR kOmega";

static const struct {
    const char *name, *form;
    size_t links;
    const lg_named_values *given; /* one parameter, or NULL */
    const char *layout;
    size_t dim, reported, invariants;
    const char *labels;
} layouts[] = {
    {"pendulum-chain", "lagrangian", 2, &only_gravity, "q1 omega1 q2 omega2", 12, 12, 2, "g m1 m2 L1 L2"},
    {"pendulum-chain", "hamiltonian", 1, &only_gravity, "q1 p1", 6, 6, 2, "g m1 L1"},
    {"oscillator", NULL, 0, NULL, "q p", 2, 2, 1, ""},
    {"quartic", NULL, 0, NULL, "q p", 4, 4, 1, ""},
    {"coupled-oscillators", NULL, 0, NULL, "q p", 4, 4, 2, ""},
    {"rigid-body", NULL, 0, &unit_body, "mu", 3, 3, 2, "I1 I2 I3"},
    {"rigid-body-attitude", NULL, 0, &unit_body, "R pi", 12, 12, 2, "I1 I2 I3"},
    {"heavy-top", "cotangent", 0, NULL, "Q pi", 12, 12, 2, top_labels},
    {"heavy-top", "direct", 0, NULL, "Q pi", 12, 12, 2, top_labels},
    {"heavy-top", "lie-poisson", 0, NULL, "Gamma Pi", 6, 6, 3, top_labels},
    {"heavy-top", "quadratic", 0, NULL, "Q pi", 18, 12, 2, top_labels},
    {"satellite", NULL, 0, NULL, "R pi q p", 18, 18, 4, "I1 I2 I3 m L d1 d2 d3 k a1 a2 a3"},
    {"quadrotors", "exact-thrusts", 0, &two_masses, "y v q1 omega1 q2 omega2", 18, 18, 0, quadrotor_labels},
    {"quadrotors", "attitudes", 0, &two_masses, "y v q1 omega1 q2 omega2 R1 Omega1 R2 Omega2", 42, 42, 0,
     quadrotor_labels},
};

TEST("layouts, sizes and labels of parameters are right") {
    for (size_t i = 0; i < LG_COUNT(layouts); i++) {
        const lg_system_options options =
            options_of(layouts[i].form, layouts[i].links, layouts[i].given, layouts[i].given != NULL);
        lg_system *system = make_system_with(layouts[i].name, &options);
        char labels[128] = "", label[32];
        for (size_t k = 0; k < lg_system_parameter_count(system); k++) {
            lg_system_parameter_label(system, k, label);
            (void)snprintf(labels + strlen(labels), sizeof labels - strlen(labels), "%s%s", k > 0 ? " " : "",
                           label);
        }
        lg_system_parameter_label(system, lg_system_parameter_count(system), label);
        assert_string_equal(label, "");
        assert_string_equal(labels, layouts[i].labels);
        assert_string_equal(lg_system_name(system), layouts[i].name);
        assert_true(layouts[i].form != NULL ? strcmp(lg_system_form(system), layouts[i].form) == 0
                                            : lg_system_form(system) == NULL);
        assert_string_equal(lg_system_layout(system), layouts[i].layout);
        assert_int_equal(lg_system_links(system), layouts[i].links);
        assert_int_equal(lg_system_dim(system), layouts[i].dim);
        assert_int_equal(lg_system_reported(system), layouts[i].reported);
        assert_int_equal(lg_system_invariants(system), layouts[i].invariants);
    }
}

TEST("a chain may have a million links") {
    const lg_system_options options = options_of(NULL, 1000000, &only_gravity, 1);
    lg_system *system = make_system_with("pendulum-chain", &options);
    const char *layout = lg_system_layout(system), *end = " q999999 omega999999 q1000000 omega1000000";
    assert_int_equal(lg_system_dim(system), 6000000);
    assert_int_equal(lg_system_parameter_count(system), 2000001);
    assert_string_equal(layout + strlen(layout) - strlen(end), end);
}

TEST("parameters are stored in the order of the table, whatever order they are given in") {
    const lg_named_values given[] = {{"lengths", unlike, 3}, {"gravity", &gravity, 1}};
    const double expected[7] = {9.81, 1.0, 1.0, 1.0, 1.0, 1.3, 0.7};
    const lg_system_options options = options_of(NULL, 3, given, 2);
    assert_memory_equal(lg_system_parameter_values(make_system_with("pendulum-chain", &options)), expected,
                        sizeof(expected));
}

/* The system must be refused with this status, and the message must contain both words. */
static void refused(const char *name, const lg_system_options *options, lg_status status, const char *first,
                    const char *second) {
    lg_system *system = NULL;
    lg_error error = {LG_OK, ""};
    assert_status(lg_system_create(NULL, name, options, &system, &error), status);
    assert_null(system);
    assert_int_equal(error.status, status);
    assert_says(error.message, first);
    assert_says(error.message, second);
    assert_status(lg_system_create(NULL, name, options, &system, NULL), status);
}

static const double zero[] = {1.0, 0.0, 1.0}, negative[] = {-1.0, 1.0, 1.0}, wild[] = {1.0, 1.0, NAN},
                    infinite[] = {INFINITY, 1.0, 1.0}, tall[] = {0.0, 1.1, 0.0};

/* In addition to gravity, another parameter of a chain of three links; for other systems the only
 * parameter. */
static const struct {
    const char *name;
    lg_named_values given;
    const char *first, *second;
} bad_values[] = {
    {"pendulum-chain", {"masses", zero, 3}, "masses", "[1]"},
    {"pendulum-chain", {"masses", negative, 3}, "masses", "[0]"},
    {"pendulum-chain", {"masses", wild, 3}, "masses", "[2]"},
    {"pendulum-chain", {"masses", infinite, 3}, "masses", "[0]"},
    {"pendulum-chain", {"lengths", zero, 3}, "lengths", "[1]"},
    {"pendulum-chain", {"lengths", wild, 3}, "lengths", "[2]"},
    {"pendulum-chain", {"mass", ones, 3}, "\"mass\"", "gravity, masses, lengths"},
    {"pendulum-chain", {NULL, ones, 3}, "no parameter", "gravity, masses, lengths"},
    {"pendulum-chain", {"gravity", &gravity, 1}, "gravity", "twice"},
    {"pendulum-chain", {"masses", ones, 2}, "2 numbers", "expected 3, one per link"},
    {"pendulum-chain", {"masses", ones, 1}, "1 number given", "one per link"},
    {"pendulum-chain", {"masses", NULL, 3}, "0 numbers", "masses"},
    {"oscillator", {"gravity", &gravity, 1}, "\"gravity\"", "it has no parameters"},
    {"oscillator", {NULL, &gravity, 1}, "\"(null)\"", "it has no parameters"},
    {"quadrotors", {"beta", &gravity, 1}, "beta", "is not an angle"},
    {"heavy-top", {"chi", tall, 3}, "chi", ""},
    {"heavy-top", {"mass", negative, 1}, "mass", ""},
    {"heavy-top", {"gravity", negative, 1}, "gravity", ""},
    {"rigid-body", {"inertia", zero, 3}, "inertia", "[1]"},
    {"rigid-body", {"inertia", wild, 3}, "inertia", "[2]"},
    {"rigid-body-attitude", {"inertia", ones, 2}, "2 numbers", "expected 3"},
};

TEST("unknown systems and forms and invalid parameters are refused by name") {
    for (size_t i = 0; i < LG_COUNT(bad_values); i++) {
        const lg_named_values given[] = {only_gravity, bad_values[i].given};
        const bool chain = strcmp(bad_values[i].name, "pendulum-chain") == 0;
        const lg_system_options options = options_of(NULL, chain ? 3 : 0, given + !chain, chain ? 2 : 1);
        refused(bad_values[i].name, &options, LG_INVALID_ARGUMENT, bad_values[i].first, bad_values[i].second);
    }
    lg_system_options options = options_of(NULL, 3, &only_gravity, 1);
    refused("pendulum", &options, LG_NOT_FOUND, "\"pendulum\"", "oscillator, quartic");
    refused(NULL, &options, LG_INVALID_ARGUMENT, "NULL", "name");
    options.form = "newtonian";
    refused("pendulum-chain", &options, LG_NOT_FOUND, "\"newtonian\"", "lagrangian, hamiltonian");
    refused("oscillator", &options, LG_NOT_FOUND, "\"newtonian\"", "one form only");
    options = options_of(NULL, 3, &(lg_named_values){"gravity", ones, 2}, 1);
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "2 numbers", "expected 1");
    options = options_of(NULL, 3, &(lg_named_values){"gravity", infinite, 1}, 1);
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "gravity = inf", "not finite");
    options.parameters = NULL;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "parameters", "NULL");
    options.parameter_count = 0;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "\"gravity\"", "must be given");
    refused("pendulum-chain", NULL, LG_INVALID_ARGUMENT, "\"gravity\"", "must be given");
    options = options_of(NULL, 3, &only_gravity, 1);
    static const size_t links[] = {0, 1000001, SIZE_MAX};
    for (size_t i = 0; i < LG_COUNT(links); i++) {
        options.links = links[i];
        refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "links", "1000000");
    }
    options.size = 3;
    refused("pendulum-chain", &options, LG_INVALID_ARGUMENT, "size", "3");
    lg_system_destroy(NULL);
}

TEST("functions for chains refuse other systems and coordinates") {
    lg_system *quartic = make_system_with("quartic", NULL), *chain = make_chain(NULL, 1, 1.0, NULL, NULL);
    double x[36] = {0}, work[64];
    lg_system_user user;
    lg_ode ode;
    lg_system_taped_user taped_user;
    lg_taped_ode taped;
    const lg_coordinates unknown = (lg_coordinates)(LG_COORDINATES_AMBIENT + 1);
    assert_status(lg_chain_mass_matrix(quartic, x), LG_UNSUPPORTED);
    assert_status(lg_chain_potential_weights(quartic, x), LG_UNSUPPORTED);
    assert_status(lg_chain_momenta(quartic, x, x, work), LG_UNSUPPORTED);
    assert_status(lg_chain_velocities(quartic, x, x, work), LG_UNSUPPORTED);
    assert_status(lg_chain_velocities(chain, x, x, work), LG_NOT_FINITE); /* links of length 0 */
    assert_status(lg_system_ode(quartic, unknown, &ode, &user, work), LG_INVALID_ARGUMENT);
    assert_status(lg_system_taped_ode(chain, unknown, LG_NONE, &taped, &taped_user), LG_INVALID_ARGUMENT);
}

TEST("the midpoint rule keeps H of the oscillator of Figure 1.1 exactly") {
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
}
