/* Symmetries of potentials: invariants of rotations as inputs of the network, and what the learned flow then
 * conserves.
 * ctest-labels: src/hamiltonian src/model */
#include "support/model_support.h"

#include "liegrad/mechanics.h"
#include "hamiltonian/internal.h"

/* Every symmetry by invariants, of every family that has it. */
static const struct symmetric_row {
    const lg_hamiltonian_family *family;
    uint32_t n;
    lg_symmetry symmetry;
} rows[] = {{&lg_hamiltonian_chain, 1, LG_SYMMETRY_AXIAL},
            {&lg_hamiltonian_chain, 2, LG_SYMMETRY_AXIAL},
            {&lg_hamiltonian_chain, 3, LG_SYMMETRY_AXIAL},
            {&lg_hamiltonian_chain, 2, LG_SYMMETRY_SPHERICAL},
            {&lg_hamiltonian_chain, 3, LG_SYMMETRY_SPHERICAL},
            {&lg_hamiltonian_rotation, 1, LG_SYMMETRY_AXIAL},
            {&lg_hamiltonian_rotation_direction, 1, LG_SYMMETRY_AXIAL},
            {&lg_hamiltonian_rotation_direction, 1, LG_SYMMETRY_SPHERICAL},
            {&lg_hamiltonian_separable, 1, LG_SYMMETRY_SPHERICAL},
            {&lg_hamiltonian_separable, 2, LG_SYMMETRY_SPHERICAL},
            {&lg_hamiltonian_separable, 3, LG_SYMMETRY_SPHERICAL}};

/* Random parameters; the weights of the potential are `size` times as large as initial ones. */
static built build_row(const struct symmetric_row *row, lg_potential_kind potential, lg_symmetry symmetry,
                       double size) {
    const uint32_t hidden[2] = {9, 8};
    lg_hamiltonian model;
    assert_ok(lg_hamiltonian_init(&model, row->family, row->n, potential, hidden, 2, LG_TANH));
    assert_ok(lg_hamiltonian_set_symmetry(&model, symmetry));
    model.scales =
        (lg_hamiltonian_scales){0.7, {row->family->scaled[0] ? 1.7 : 1.0, 0.6, 1.0, 0.6, 1.0, 1.0}};
    double *theta = room(lg_hamiltonian_parameters(&model));
    lg_rng rng = test_rng(31, row->n);
    lg_hamiltonian_initialise(&model, &rng, theta);
    for (size_t i = 0; i < lg_mlp_parameters(&model.net); i++) theta[i] *= size;
    return build_from(&model, theta);
}

static size_t block_of(const struct symmetric_row *row) {
    return row->family == &lg_hamiltonian_separable ? row->n : 3;
}

/* How many numbers at the start of a state are a rotation. */
static size_t turned_of(const struct symmetric_row *row) {
    return 9 * row->family->bodies.rotations;
}

static void turn_pair(double *a, double *b, double angle) {
    const double x = *a;
    *a = cos(angle) * x - sin(angle) * *b;
    *b = sin(angle) * x + cos(angle) * *b;
}

/* Rotates the axes i and j by an angle; a rotation R has vectors in its columns. */
static void turn(const struct symmetric_row *row, double *y, size_t d, size_t i, size_t j, double angle) {
    const size_t turned = turned_of(row), block = block_of(row);
    for (size_t c = 0; c < 3 && turned > 0; c++) turn_pair(y + 3 * i + c, y + 3 * j + c, angle);
    for (size_t at = turned; at < d; at += block) turn_pair(y + at + i, y + at + j, angle);
}

/* Whether number i of a state with d numbers is a momentum. */
static bool is_momentum(const struct symmetric_row *row, size_t i, size_t d) {
    const size_t turned = turned_of(row);
    if (row->family == &lg_hamiltonian_separable) return i >= d / 2;
    if (turned == 0) return i % 6 > 2;
    return i >= turned && (i < turned + 3 || (i - turned - 3) % 6 > 2);
}

/* A random rotation of the group; about e3 only for an axial symmetry. */
static void turn_by_group(const struct symmetric_row *row, lg_rng *rng, double *y, size_t d) {
    const size_t block = block_of(row), axes = row->symmetry == LG_SYMMETRY_AXIAL ? 2 : block;
    for (size_t i = 0; i < axes; i++)
        for (size_t j = i + 1; j < axes; j++) turn(row, y, d, i, j, 6.0 * lg_rng_uniform(rng));
}

TEST("the energy does not change under the rotations of its symmetry, and under others it does") {
    for (size_t r = 0; r < LG_COUNT(rows); r++)
        for (int potential = 0; potential < LG_POTENTIAL_KIND_COUNT; potential++) {
            const struct symmetric_row *row = &rows[r];
            const built b = build_row(row, (lg_potential_kind)potential, row->symmetry, 1.0),
                        plain = build_row(row, (lg_potential_kind)potential, LG_SYMMETRY_NONE, 1.0);
            const size_t d = lg_model_inputs(b.model), block = block_of(row);
            lg_rng rng = test_rng(32, 0);
            for (int k = 0; k < 10; k++) {
                double y[MOST_STATE], turned[MOST_STATE];
                draw_state(&b, &rng, y);
                memcpy(turned, y, d * sizeof *y);
                turn_by_group(row, &rng, turned, d);
                assert_close(energy_of(&b, turned), energy_of(&b, y), 1e-13, 1e-13);
                if (block > 1) assert_true(fabs(energy_of(&plain, turned) - energy_of(&plain, y)) > 1e-4);
                if (row->symmetry != LG_SYMMETRY_AXIAL) continue;
                turn(row, turned, d, 1, 2, 0.5);
                assert_true(fabs(energy_of(&b, turned) - energy_of(&b, y)) > 1e-6);
            }
        }
}

TEST("a mirror image has another energy if the potential is axial, and the same if it is spherical") {
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        const struct symmetric_row *row = &rows[r];
        if (row->n < 2 || row->family != &lg_hamiltonian_chain) continue;
        const built b = build_row(row, LG_POTENTIAL_MLP, row->symmetry, 1.0);
        const size_t d = lg_model_inputs(b.model);
        double y[MOST_STATE], mirrored[MOST_STATE];
        lg_rng rng = test_rng(33, 0);
        draw_state(&b, &rng, y);
        for (size_t i = 0; i < d; i++) mirrored[i] = i % 3 == 1 ? -y[i] : y[i];
        const double gap = fabs(energy_of(&b, mirrored) - energy_of(&b, y));
        assert_true(row->symmetry == LG_SYMMETRY_AXIAL ? gap > 1e-4 : gap < 1e-13);
    }
}

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

TEST("the invariants of three directions stand in their order") {
    lg_hamiltonian model;
    double y[18] = {0}, theta[32] = {0};
    assert_ok(lg_hamiltonian_init(&model, &lg_hamiltonian_chain, 3, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    lg_rng rng = test_rng(34, 0);
    for (size_t i = 0; i < 3; i++) { /* p = 0: the energy is V */
        for (size_t c = 0; c < 3; c++) y[6 * i + c] = lg_rng_normal(&rng);
        const double size = sqrt(dot(y + 6 * i, y + 6 * i));
        for (size_t c = 0; c < 3; c++) y[6 * i + c] /= size;
    }
    const double *q1 = y, *q2 = y + 6, *q3 = y + 12;
#define TWIST(a, b) ((a)[0] * (b)[1] - (a)[1] * (b)[0])
    const double inner[3] = {dot(q1, q2), dot(q1, q3), dot(q2, q3)},
                 axial[9] = {q1[2],    q2[2],         q3[2],         inner[0],     inner[1],
                             inner[2], TWIST(q1, q2), TWIST(q1, q3), TWIST(q2, q3)};
    for (int spherical = 0; spherical < 2; spherical++) {
        assert_ok(lg_hamiltonian_set_symmetry(&model, spherical ? LG_SYMMETRY_SPHERICAL : LG_SYMMETRY_AXIAL));
        const size_t count = spherical ? LG_COUNT(inner) : LG_COUNT(axial);
        assert_int_equal(lg_mlp_parameters(&model.net), count);
        for (size_t i = 0; i < count; i++) {
            memset(theta, 0, sizeof theta);
            theta[i] = 1.0;
            for (size_t j = 0; j < 3; j++) theta[count + 9 + j] = 1.0; /* b: the unit mass matrix */
            const built b = build_from(&model, theta);
            assert_close(energy_of(&b, y), spherical ? inner[i] : axial[i], 1e-14, 1e-15);
        }
    }
}

TEST("gradients of symmetric potentials agree with differences") {
    for (size_t r = 0; r < LG_COUNT(rows); r++)
        for (int potential = 0; potential < LG_POTENTIAL_KIND_COUNT; potential++) {
            const built b = build_row(&rows[r], (lg_potential_kind)potential, rows[r].symmetry, 1.0);
            const size_t d = lg_model_inputs(b.model);
            double y[MOST_STATE], gradient[MOST_STATE], energy, slope;
            lg_rng rng = test_rng(35, 0);
            draw_state(&b, &rng, y);
            for (size_t i = 0; i < d; i++) /* p = 0 */
                if (is_momentum(&rows[r], i, d)) y[i] = 0.0;
            lg_model_jacobian(b.model, y, &energy, gradient, b.work);
            for (size_t i = 0; i < d; i++) {
                if (is_momentum(&rows[r], i, d)) continue;
                test_slope(model_value_at, &(model_value){b.model, b.work}, y, i, 1e-5, 1, 1, &slope);
                assert_close(gradient[i], slope, 1e-7, 1e-9);
            }
        }
}

/* The components of sum_i q_i x p_i, plus pi of a rotation, that the symmetry conserves. */
static size_t momenta_of(const struct symmetric_row *row, const double *y, double *out) {
    const bool chain = row->family == &lg_hamiltonian_chain, bodies = turned_of(row) > 0;
    const size_t block = block_of(row), n = chain ? row->n : bodies ? row->family->bodies.directions : 1;
    size_t count = 0;
    for (size_t i = 0; i < block; i++)
        for (size_t j = i + 1; j < block; j++) {
            double sum = !bodies ? 0.0 : i == 0 && j == 2 ? -y[10] : y[9 + 3 - i - j];
            for (size_t k = 0; k < n; k++) {
                const double *q = y + (bodies ? 12 : 0) + 2 * block * k, *p = q + block;
                sum += q[i] * p[j] - q[j] * p[i];
            }
            if (row->symmetry == LG_SYMMETRY_AXIAL && j == 2) continue;
            out[count++] = sum;
        }
    return count;
}

static double drift_of(const struct symmetric_row *row, lg_symmetry symmetry) {
    enum { POINTS = 21 };
    const built b = build_row(row, LG_POTENTIAL_MLP, symmetry, 3.0);
    const size_t d = lg_model_inputs(b.model);
    double *path = room(POINTS * d), times[POINTS], y[MOST_STATE], first[3], later[3], most = 0.0;
    char space[LG_SPACE_TEXT];
    lg_ode ode;
    lg_model_user user;
    lg_rng rng = test_rng(36, 0);
    draw_state(&b, &rng, y);
    for (size_t i = 0; i < POINTS; i++) times[i] = 0.1 * (double)i;
    lg_space_text(lg_model_space(b.model), space);
    assert_ok(lg_model_ode(b.model, &ode, &user, b.work));
    assert_ok(lg_ode_solve(NULL, space, ode.field, ode.user, 1e-12, times, POINTS, y, path, NULL));
    const size_t count = momenta_of(row, path, first);
    for (size_t i = 1; i < POINTS; i++) {
        (void)momenta_of(row, path + i * d, later);
        for (size_t j = 0; j < count; j++) most = fmax(most, fabs(later[j] - first[j]));
    }
    return most;
}

TEST("the learned flow conserves the momenta that belong to the symmetry, to the integration error") {
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        if (block_of(&rows[r]) == 1) continue;
        const double with = drift_of(&rows[r], rows[r].symmetry),
                     without = drift_of(&rows[r], LG_SYMMETRY_NONE);
        print_message("  %-10s n = %u: momentum changes by %.1e, without symmetry by %.1e\n",
                      rows[r].family->name, rows[r].n, with, without);
        assert_true(with < 1e-9);
        assert_true(without > 1e-2);
    }
}

/* ---- whether data have the symmetry ---- */

enum { PATHS = 6, PATH_POINTS = 12 };

/* Trajectories of a random model with this symmetry. `damping` multiplies all momenta by exp(-damping dt)
 * after each step, `noise` is added to all numbers but those of the first points, all times `units`. */
static lg_momentum_motion motion_of(const struct symmetric_row *row, lg_symmetry symmetry, double damping,
                                    double noise, double units) {
    const built b = build_row(row, LG_POTENTIAL_MLP, symmetry, 3.0);
    const size_t d = lg_model_inputs(b.model);
    double *data = room(PATHS * PATH_POINTS * d), times[2] = {0.0, 0.2}, pair[2 * MOST_STATE];
    char space[LG_SPACE_TEXT];
    lg_momentum_motion out;
    lg_ode ode;
    lg_model_user user;
    lg_rng rng = test_rng(37, row->n);
    lg_space_text(lg_model_space(b.model), space);
    assert_ok(lg_model_ode(b.model, &ode, &user, b.work));
    for (size_t i = 0; i < PATHS; i++) {
        double *path = data + i * PATH_POINTS * d;
        draw_state(&b, &rng, path);
        for (size_t j = 1; j < PATH_POINTS; j++) {
            assert_ok(lg_ode_solve(NULL, space, ode.field, ode.user, 1e-10, times, 2, path + (j - 1) * d,
                                   pair, NULL));
            for (size_t k = 0; k < d; k++)
                path[j * d + k] = pair[d + k] * (is_momentum(row, k, d) ? exp(-damping * times[1]) : 1.0);
        }
    }
    for (size_t i = 0; i < PATHS * PATH_POINTS; i++)
        for (size_t k = 0; k < d; k++) {
            const bool momentum = is_momentum(row, k, d);
            if (i % PATH_POINTS > 0) data[i * d + k] += noise * lg_rng_normal(&rng);
            if (momentum) data[i * d + k] *= units;
        }
    lg_hamiltonian model = b.hamiltonian;
    model.symmetry = row->symmetry; /* what the user claims */
    const lg_hamiltonian_problem problem = {.model = &model,
                                            .trajectories = PATHS,
                                            .points = PATH_POINTS,
                                            .dt = 0.2,
                                            .data = data,
                                            .scheme = lg_scheme_find("rkmk4"),
                                            .substeps = 1};
    assert_ok(lg_hamiltonian_momentum_motion(NULL, &problem, &out));
    return out;
}

TEST("the momentum of a symmetry moves along data without it, and not along data with it, damped or noisy") {
    static const double units[] = {1.0, 1e-9, 1e9};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        if (block_of(&rows[r]) == 1) continue;
        for (size_t u = 0; u < LG_COUNT(units); u++) {
            const lg_momentum_motion with = motion_of(&rows[r], rows[r].symmetry, 0.0, 0.0, units[u]),
                                     damped = motion_of(&rows[r], rows[r].symmetry, 0.3, 0.0, units[u]),
                                     noisy = motion_of(&rows[r], rows[r].symmetry, 0.0, 0.02, units[u]),
                                     without = motion_of(&rows[r], LG_SYMMETRY_NONE, 0.0, 0.0, units[u]);
            print_message("  %-18s n = %u: %.1e with, %.1e damped, %.1e without, of %.1e\n",
                          rows[r].family->name, rows[r].n, with.moved, damped.moved, without.moved,
                          without.size);
            assert_false(with.moves);
            assert_false(damped.moves);
            assert_false(noisy.moves);
            assert_true(without.moves);
            assert_true(with.moved < 1e-7 * with.size);
            assert_true(damped.moved > 5e-3 * with.size);
        }
    }
}

/* V = sin |q|^2 with |q| in the units of the data: the scale of |q|^2 is the square of the scale of q. */
TEST("angles of a dictionary of |q|^2 are in the units of the data") {
    lg_hamiltonian model;
    double theta[16] = {0};
    const double y[4] = {1.1, -0.3, 0.0, 0.0};
    assert_ok(
        lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, LG_POTENTIAL_DICTIONARY, NULL, 0, LG_TANH));
    assert_ok(lg_hamiltonian_set_symmetry(&model, LG_SYMMETRY_SPHERICAL));
    assert_int_equal(lg_mlp_parameters(&model.net), 6); /* of one coordinate */
    model.scales = (lg_hamiltonian_scales){1.0, {4.0, 0.25}};
    theta[4] = 1.0;
    const built b = build_from(&model, theta);
    assert_close(energy_of(&b, y), sin(1.1 * 1.1 + 0.3 * 0.3), 1e-14, 0.0);
}

/* A = (1, 2; 3, 4): |A|^2 = 30. */
TEST("the kinetic energy of a spherical separable system is |A|^2 |p|^2/(2 n)") {
    const double theta[5] = {0.0, 1.0, 2.0, 3.0, 4.0}, y[4] = {0.0, 0.0, 0.5, -2.0};
    lg_hamiltonian model;
    assert_ok(
        lg_hamiltonian_init(&model, &lg_hamiltonian_separable, 2, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    assert_ok(lg_hamiltonian_set_symmetry(&model, LG_SYMMETRY_SPHERICAL));
    const built b = build_from(&model, theta);
    assert_close(energy_of(&b, y), 30.0 * 4.25 / 4.0, 1e-14, 0.0);
}

TEST("a symmetry that the family cannot have is refused") {
    static const struct {
        const lg_hamiltonian_family *family;
        uint32_t n;
        lg_potential_kind potential;
        lg_symmetry symmetry;
        lg_status status;
    } row[] = {
        {&lg_hamiltonian_chain, 1, LG_POTENTIAL_MLP, LG_SYMMETRY_SPHERICAL, LG_UNSUPPORTED},
        {&lg_hamiltonian_separable, 3, LG_POTENTIAL_MLP, LG_SYMMETRY_AXIAL, LG_UNSUPPORTED},
        {&lg_hamiltonian_chain, 10, LG_POTENTIAL_DICTIONARY, LG_SYMMETRY_AXIAL, LG_UNSUPPORTED},
        {&lg_hamiltonian_chain, 14, LG_POTENTIAL_DICTIONARY, LG_SYMMETRY_SPHERICAL, LG_OK},
        {&lg_hamiltonian_chain, 14, LG_POTENTIAL_LINEAR, LG_SYMMETRY_AXIAL, LG_OK},
        {&lg_hamiltonian_chain, 2, LG_POTENTIAL_MLP, (lg_symmetry)LG_SYMMETRY_COUNT, LG_INVALID_ARGUMENT}};
    const uint32_t hidden[1] = {4};
    for (size_t r = 0; r < LG_COUNT(row); r++) {
        lg_hamiltonian model;
        assert_ok(lg_hamiltonian_init(&model, row[r].family, row[r].n, row[r].potential, hidden, 1, LG_TANH));
        const size_t before = lg_hamiltonian_parameters(&model);
        assert_status(lg_hamiltonian_set_symmetry(&model, row[r].symmetry), row[r].status);
        assert_int_equal(model.symmetry, row[r].status == LG_OK ? row[r].symmetry : LG_SYMMETRY_NONE);
        if (row[r].status == LG_OK) continue;
        assert_int_equal(lg_hamiltonian_parameters(&model), before);
    }
    lg_hamiltonian none = {.family = &lg_hamiltonian_chain, .n = 2};
    assert_status(lg_hamiltonian_set_symmetry(&none, LG_SYMMETRY_AXIAL), LG_INVALID_ARGUMENT);
    none.potential = (lg_potential_kind)LG_POTENTIAL_KIND_COUNT;
    assert_status(lg_hamiltonian_set_symmetry(&none, LG_SYMMETRY_AXIAL), LG_INVALID_ARGUMENT);
    none = (lg_hamiltonian){.n = 2};
    assert_status(lg_hamiltonian_set_symmetry(&none, LG_SYMMETRY_AXIAL), LG_INVALID_ARGUMENT);
}
