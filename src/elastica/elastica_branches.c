/* Search for all equilibria from many starts. */
#include <math.h>
#include <string.h>

#include "liegrad/core.h"
#include "elastica/elastica.h"

#define RANDOM_STARTS 64
/* Rate of the gradient flow. The energy's curvatures along the longest waves are about 10 to 100. */
#define FLOW_RATE  200.0
#define FLOWS      5 /* Newton's method is tried after 2, 6, 14, 30 and 62 steps of the flow */
#define FLOW_LIMIT 40
#define MODES      5
#define PATH_STEP  0.05
/* Two equilibria are the same if their angles differ by less than this at every node, radians. */
#define SAME 1e-6

/* Amplitudes of sin(m pi s/L), m = 1 .. MODES, that are added to the straight line from theta_0 to theta_N.
 * The shapes are arches and loops to either side, S-shapes, and combinations of them. */
static const double regular[][MODES] = {{0},
                                        {1},
                                        {-1},
                                        {2.5},
                                        {-2.5},
                                        {4},
                                        {-4},
                                        {6},
                                        {-6},
                                        {0, 1.5},
                                        {0, -1.5},
                                        {0, 3},
                                        {0, -3},
                                        {0, 5},
                                        {0, -5},
                                        {2, 2},
                                        {2, -2},
                                        {-2, 2},
                                        {-2, -2},
                                        {4, 3},
                                        {4, -3},
                                        {-4, 3},
                                        {-4, -3},
                                        {0, 0, 2},
                                        {0, 0, -2},
                                        {3, 0, 2},
                                        {3, 0, -2},
                                        {-3, 0, 2},
                                        {-3, 0, -2},
                                        {0, 0, 0, 2},
                                        {0, 0, 0, -2},
                                        {6, 0, 2},
                                        {-6, 0, -2},
                                        {8, 0, 1},
                                        {-8, 0, -1},
                                        {0, 0, 0, 0, 2},
                                        {0, 0, 0, 0, -2}};
/* Each start is used twice: as it stands, and with the amplitudes multiplied by sqrt(1 - d), which is the
 * size of the angles of a nearly straight beam. */
#define STARTS        (2 * (LG_COUNT(regular) + RANDOM_STARTS))
#define BETWEEN       8 /* number of starts between two minima */
#define BETWEEN_TILTS 3 /* number of variants of each: 0, 1 or -1 times sqrt(1 - d) sin(2 pi s/L) is added */

static void set_start(const lg_beam *beam, size_t number, double *theta) {
    double modes[MODES];
    const double scale = number % 2 == 0 ? 1.0 : sqrt(1.0 - beam->d);
    if (number / 2 < LG_COUNT(regular)) {
        memcpy(modes, regular[number / 2], sizeof modes);
    } else {
        lg_rng rng;
        lg_rng_seed(&rng, 1, number / 2);
        for (int m = 0; m < MODES; m++) modes[m] = 4.0 / sqrt(m + 1.0) * lg_rng_normal(&rng);
    }
    for (size_t k = 0; k <= beam->n; k++) {
        const double t = (double)k / (double)beam->n;
        theta[k] = (1.0 - t) * beam->first + t * beam->last;
        for (int m = 0; k > 0 && k < beam->n && m < MODES; m++)
            theta[k] += scale * modes[m] * sin((m + 1) * LG_PI * t);
    }
    theta[0] = beam->first;
    theta[beam->n] = beam->last;
}

/* The branches found so far, sorted by energy. */
typedef struct branch_list {
    size_t room, count, nodes;
    double *theta;
    lg_beam_branch *branches;
} branch_list;

static bool is_known(const branch_list *list, const double *theta) {
    for (size_t i = 0; i < list->count; i++) {
        const double *other = list->theta + i * list->nodes;
        double largest = 0.0;
        for (size_t k = 0; k < list->nodes; k++) largest = fmax(largest, fabs(theta[k] - other[k]));
        if (largest < SAME) return true;
    }
    return false;
}

/* Whether branch a is sorted before branch b: by energy. Mirror images have the same energy up to rounding;
 * of such a pair the one with the larger first inner angle comes first. */
static bool goes_before(const lg_beam_branch *a, const double *theta_a, const lg_beam_branch *b,
                        const double *theta_b) {
    if (fabs(a->energy - b->energy) > 1e-11 * fmax(fabs(a->energy), fabs(b->energy)))
        return a->energy < b->energy;
    return theta_a[1] > theta_b[1];
}

static void insert(branch_list *list, const lg_beam_branch *branch, const double *theta) {
    const size_t nodes = list->nodes;
    size_t at = 0;
    while (at < list->count && !goes_before(branch, theta, &list->branches[at], list->theta + at * nodes))
        at++;
    if (at >= list->room) return;
    if (list->count < list->room) list->count++;
    const size_t moved = list->count - 1 - at;
    memmove(list->branches + at + 1, list->branches + at, moved * sizeof *list->branches);
    memmove(list->theta + (at + 1) * nodes, list->theta + at * nodes, moved * nodes * sizeof(double));
    list->branches[at] = *branch;
    memcpy(list->theta + at * nodes, theta, nodes * sizeof(double));
}

/* Adds the mirror image of the branch in w->theta. If the sum c of the end angles is a whole number of turns
 * and theta(s) is a solution, then c - theta(L - s) is a solution, too. Overwrites w->way. */
static void take_image(branch_list *list, const lg_beam *beam, lg_beam_work *w, lg_beam_branch branch) {
    const size_t n = beam->n;
    const double sum = beam->first + beam->last;
    if (fabs(remainder(sum, 2.0 * LG_PI)) > 1e-14) return;
    for (size_t k = 0; k <= n; k++) w->way[k] = sum - w->theta[n - k];
    w->way[0] = beam->first;
    w->way[n] = beam->last;
    branch.force[1] = -branch.force[1];
    if (!is_known(list, w->way)) insert(list, &branch, w->way);
}

static void take(branch_list *list, const lg_beam *beam, lg_beam_work *w, uint32_t iterations) {
    if (is_known(list, w->theta)) return;
    const lg_beam_branch branch = {.energy = lg_beam_energy(beam, w->theta),
                                   .gradient = lg_beam_gradient(beam, w),
                                   .force = {w->force[0], w->force[1]},
                                   .negative = w->negative,
                                   .iterations = iterations};
    insert(list, &branch, w->theta);
    take_image(list, beam, w, branch);
}

/* A stationary point where the angles of neighbouring nodes differ by a right angle or more has a kink. It is
 * an artefact of the grid. */
static bool is_kinked(const lg_beam *beam, const double *theta) {
    for (size_t k = 0; k < beam->n; k++)
        if (!(fabs(theta[k + 1] - theta[k]) < 0.5 * LG_PI)) return true;
    return false;
}

/* Follows the gradient flow from w->base, which passes near saddles, and starts Newton's method from several
 * points along it. */
static void search_saddles(const lg_beam *beam, lg_beam_work *w, branch_list *list) {
    const uint32_t limit = w->limit;
    w->limit = limit < FLOW_LIMIT ? limit : FLOW_LIMIT;
    for (int i = 0, steps = 2; i < FLOWS; i++, steps *= 2) {
        const uint32_t before = w->iterations;
        memcpy(w->theta, w->base, (beam->n + 1) * sizeof(double));
        lg_beam_flow(beam, w, FLOW_RATE, steps);
        memcpy(w->base, w->theta, (beam->n + 1) * sizeof(double));
        w->problems++;
        const lg_beam_end end = lg_beam_stationary(beam, w);
        if (end == LG_BEAM_MINIMUM || (end == LG_BEAM_SADDLE && !is_kinked(beam, w->theta)))
            take(list, beam, w, w->iterations - before);
    }
    w->limit = limit;
}

static size_t minimum_rank(const branch_list *list, size_t index) {
    size_t rank = 0;
    for (size_t i = 0; i < index; i++) rank += list->branches[i].negative == 0;
    return rank;
}

/* Searches for saddles between the lowest minimum and each other minimum, because every path between two
 * minima passes over a saddle. */
static lg_status search_between(const lg_beam *beam, lg_beam_work *w, branch_list *list) {
    const size_t n = beam->n, nodes = list->nodes;
    LG_TRY_SCRATCH(double, ends, w->context, 2 * nodes, LG_OUT_OF_MEMORY);
    size_t other = 0;
    const size_t count = list->count;
    if (count > 0) memcpy(ends, list->theta, nodes * sizeof *ends);
    for (size_t minimum = 1; count > 0 && !lg_cancelled(w->context); minimum++) {
        for (other = 0; other < list->count; other++) /* the list grows during the search */
            if (list->branches[other].negative == 0 && minimum_rank(list, other) == minimum) break;
        if (other >= list->count) break;
        memcpy(ends + nodes, list->theta + other * nodes, nodes * sizeof *ends);
        for (int i = 0; i < BETWEEN * BETWEEN_TILTS; i++) {
            const double t = (i % BETWEEN + 1.0) / (BETWEEN + 1.0), tilt = (i / BETWEEN + 1) % 3 - 1.0;
            for (size_t k = 0; k <= n; k++)
                w->base[k] =
                    (1.0 - t) * ends[k] + t * ends[nodes + k] +
                    (k == n ? 0.0 : tilt * sqrt(1.0 - beam->d) * sin(2.0 * LG_PI * (double)k / (double)n));
            search_saddles(beam, w, list);
        }
    }
    return lg_cancelled(w->context) ? LG_CANCELLED : LG_OK;
}

static lg_status search(const lg_beam *beam, lg_beam_work *w, bool saddles, bool quick, branch_list *list) {
    const size_t starts = quick ? 2 * LG_COUNT(regular) : STARTS;
    /* Few starts reach a branch that is about to vanish as the boundary conditions change; continuation
     * reaches it more easily. */
    if (!quick) {
        lg_beam_end end;
        LG_TRY(lg_beam_follow(beam, w, PATH_STEP, &end));
        if (end == LG_BEAM_MINIMUM) take(list, beam, w, w->iterations);
    }
    for (size_t i = 0; i < starts; i++) {
        if (lg_cancelled(w->context)) return LG_CANCELLED;
        const uint32_t before = w->iterations;
        set_start(beam, i, w->theta);
        w->problems++;
        if (lg_beam_minimise(beam, w) == LG_BEAM_MINIMUM) take(list, beam, w, w->iterations - before);
        if (!saddles) continue;
        set_start(beam, i, w->base);
        search_saddles(beam, w, list);
    }
    return saddles ? search_between(beam, w, list) : LG_OK;
}

/* Interpolates each branch of a coarser beam to the nodes of `beam` and solves again there. */
static lg_status refine_all(const branch_list *coarse, const lg_beam *beam, lg_beam_work *w, bool saddles,
                            branch_list *list) {
    for (size_t i = 0; i < coarse->count; i++) {
        if (lg_cancelled(w->context)) return LG_CANCELLED;
        const uint32_t before = w->iterations;
        lg_beam_prolong(coarse->nodes - 1, coarse->theta + i * coarse->nodes, beam->n, w->theta);
        const lg_beam_end end =
            coarse->branches[i].negative == 0 ? lg_beam_minimise(beam, w) : lg_beam_stationary(beam, w);
        if (end == LG_BEAM_MINIMUM || (saddles && end == LG_BEAM_SADDLE))
            take(list, beam, w, w->iterations - before);
    }
    return LG_OK;
}

lg_status lg_beam_search(const lg_beam *beam, lg_beam_work *work, bool saddles, bool quick, size_t room,
                         double *theta, lg_beam_branch *branches, size_t *count) {
    lg_beam coarse = *beam;
    coarse.n = lg_beam_coarse(beam);
    branch_list list = {.room = room, .nodes = beam->n + 1, .theta = theta, .branches = branches};
    branch_list first = {.room = room, .nodes = coarse.n + 1};
    if (coarse.n == beam->n) {
        LG_TRY(search(beam, work, saddles, quick, &list));
    } else {
        LG_TRY_SCRATCH(double, angles, work->context, room *first.nodes, LG_OUT_OF_MEMORY);
        LG_TRY_SCRATCH(lg_beam_branch, found, work->context, room, LG_OUT_OF_MEMORY);
        first.theta = angles, first.branches = found;
        LG_TRY(search(&coarse, work, saddles, quick, &first));
        LG_TRY(refine_all(&first, beam, work, saddles, &list));
    }
    *count = list.count;
    return LG_OK;
}

lg_status lg_elastica_branches(const lg_context *context, const lg_elastica *problem,
                               const lg_elastica_options *options, bool saddles, size_t room, double *theta,
                               lg_elastica_solution *solutions, size_t *count, lg_error *error) {
    lg_elastica_options o;
    LG_CLEAN(lg_beam_work_destroy) lg_beam_work work = {.memory = NULL};
    LG_TRY(lg_elastica_check(problem, error));
    LG_TRY(lg_elastica_options_take(options, &o, error));
    if (room == 0 || !theta || !solutions || !count)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "elastica: the place for the branches is NULL or has no room");
    const lg_beam_frame frame = lg_beam_frame_make(problem);
    const size_t n = frame.beam.n;
    if (lg_beam_work_create(context, n, &work) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "elastica: no memory");
    work.tolerance = o.gradient_tolerance;
    work.limit = o.max_iterations;
    LG_SCRATCH(lg_beam_branch, branches, context, room);
    LG_SCRATCH(double, angles, context, room <= SIZE_MAX / 16 / (n + 1) ? room * (n + 1) : SIZE_MAX);
    LG_SCRATCH(double, curve, context, 4 * (n + 1));
    size_t found = 0;
    const lg_status status = branches && angles && curve ? lg_beam_search(&frame.beam, &work, saddles, false,
                                                                          room, angles, branches, &found)
                                                         : LG_OUT_OF_MEMORY;
    if (status != LG_OK) return lg_fail(error, status, "elastica: %s", lg_status_sentence(status));
    for (size_t i = 0; i < found; i++)
        lg_beam_export(problem, &frame, &branches[i], angles + i * (n + 1), curve, theta + i * (n + 1),
                       &solutions[i]);
    *count = found;
    return lg_fail(error, LG_OK, "%s", "");
}
