/* Training by ranks, which are threads of this process here. Any number of ranks and threads gives the bits
 * of one process, in one run or resumed.
 * ctest-labels: threads */
#include "nn_support.h"

#include "core/core.h"
#include "nn/fit_internal.h"
#include "support/fail_alloc.h"
#include "support/rank_team.h"

enum { RANKS = 3 }; /* ranks 1 to 3 */

/* ---- a problem with data per sample: o_i is added to the prediction ---- */

static lg_status own_residuals(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                               size_t batch, lg_var *residuals) {
    const regression *r = user;
    const uint32_t shared = (uint32_t)lg_mlp_parameters(&r->net), rows = (uint32_t)count;
    lg_var d = LG_NONE, parts[2];
    LG_TRY(regression_difference(r, tape, theta, samples, count, &d));
    const lg_var all = lg_slice(tape, theta, 0, shared, REGRESSION_SAMPLES);
    const lg_var own =
        lg_gather(tape, lg_reshape(tape, all, lg_shape2(REGRESSION_SAMPLES, 1)), samples, rows);
    parts[0] = lg_add(tape, d, own);
    parts[1] = lg_scale(tape, own, 0.3);
    *residuals = lg_scale(tape, lg_concat(tape, parts, 2, 1), 1.0 / sqrt((double)batch));
    return LG_OK;
}

static lg_status own_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                          size_t batch, lg_var *loss) {
    lg_var r = LG_NONE;
    LG_TRY(own_residuals(user, tape, theta, samples, count, batch, &r));
    *loss = lg_sum(tape, lg_square(tape, r));
    return LG_OK;
}

/* ---- fits of a team ---- */

typedef struct trained {
    lg_fit_problem problem;
    lg_fit_options options;
    const double *theta;
    memory_archive *from; /* NULL: from the start */
    memory_archive *to;   /* the state at the end, saved by rank 0 */
    const volatile int *cancel[TEAM_MOST];
    lg_fit_end end[TEAM_MOST];
    double *last[TEAM_MOST];          /* parameters of each rank at the end; NULL: not needed */
    lg_fail_alloc *memory[TEAM_MOST]; /* of each rank; NULL: the usual one */
} trained;

static lg_status train_rank(void *user, const lg_ranks *ranks, lg_error *error) {
    trained *t = user;
    lg_fit_options options = t->options;
    lg_context_options c;
    lg_context *context = NULL;
    lg_fit *fit = NULL;
    const uint32_t rank = ranks != NULL ? ranks->rank : 0;
    options.ranks = ranks;
    lg_context_options_init(&c);
    c.cancel = t->cancel[rank];
    if (t->memory[rank] != NULL) {
        c.allocate = lg_fail_alloc_take;
        c.release = lg_fail_alloc_release;
        c.allocator_user = t->memory[rank];
    }
    lg_status status = lg_context_create(&c, &context);
    if (status == LG_OK) status = lg_fit_create(context, &t->problem, &options, t->theta, &fit, error);
    if (status == LG_OK && t->from != NULL) {
        const lg_archive_reader reader = memory_reader(t->from);
        status = lg_fit_load(fit, &reader, error);
    }
    if (status == LG_OK) status = lg_fit_run(fit, error);
    if (status == LG_OK || status == LG_CANCELLED) {
        const lg_archive_writer writer = memory_writer(t->to);
        const lg_status saved = rank == 0 ? lg_fit_save(fit, &writer, error) : LG_OK;
        if (saved != LG_OK) status = saved;
        t->end[rank] = lg_fit_why_finished(fit);
        if (t->last[rank] != NULL) lg_fit_current_parameters(fit, t->last[rank]);
    }
    lg_fit_destroy(fit);
    lg_context_destroy(context);
    return status;
}

/* The state after training by `count` ranks; 0: by a fit without ranks. All ranks must end with
 * `expected`. */
static memory_archive trained_by(trained *t, uint32_t count, lg_status expected) {
    memory_archive to = {.count = 0};
    rank_team *team = TEST_ARRAY(rank_team, 1);
    lg_error error = {LG_OK, ""};
    t->to = &to;
    if (count == 0) {
        assert_int_equal(train_rank(t, NULL, &error), expected);
        return to;
    }
    team_run(team, count, train_rank, t);
    for (uint32_t r = 0; r < count; r++)
        if (team->members[r].status != expected)
            fail_msg("rank %u: %d, %s", r, (int)team->members[r].status, team->members[r].error.message);
    return to;
}

static trained training(regression *r, const char *plan, uint64_t epochs) {
    trained t = {
        .problem = regression_problem(r), .options = options_of(epochs, 24), .theta = regression_start(r)};
    assert_told(lg_fit_plan_parse(plan, true, &t.options.plan, &told));
    t.options.validation = 0.2;
    t.options.keep_best = true;
    return t;
}

static void own_training(trained *t, regression *r) {
    t->problem.parameters += REGRESSION_SAMPLES;
    t->problem.own = 1;
    t->problem.loss = own_loss;
    t->problem.residuals = own_residuals;
    double *theta = TEST_ARRAY(double, t->problem.parameters);
    memcpy(theta, t->theta, lg_mlp_parameters(&r->net) * sizeof *theta);
    t->theta = theta;
}

static void compare_numbers_of_ranks(trained *t) {
    const memory_archive alone = trained_by(t, 0, LG_OK);
    for (uint32_t count = 1; count <= RANKS; count++)
        for (t->options.threads = 1; t->options.threads <= 2; t->options.threads++) {
            const memory_archive together = trained_by(t, count, LG_OK);
            assert_same_state(&alone, &together);
        }
    t->options.threads = 1;
}

TEST("any number of ranks and threads gives the bits of one process, by every method") {
    static const char *const plans[] = {"adam", "ssbroyden", "lbfgs", "lm", "adam:3,ssbroyden:20,lm:5"};
    regression r = make_regression();
    for (size_t i = 0; i < LG_COUNT(plans); i++)
        for (uint32_t shards = 4; shards <= 7; shards += 3) {
            trained t = training(&r, plans[i], i == 4 ? 28 : 9);
            t.options.shards = shards;
            compare_numbers_of_ranks(&t);
        }
}

TEST("the bits are also equal in single precision, with decay, a prior and gradient clipping") {
    regression r = make_regression();
    trained t = training(&r, "adam", 8);
    t.options.dtype = LG_F32;
    t.options.clip_norm = 0.05;
    t.options.adam.weight_decay = 1e-3;
    compare_numbers_of_ranks(&t);
    t = training(&r, "ssbroyden", 130);
    t.options.prior = 1.0;
    t.problem.observations = REGRESSION_SAMPLES;
    compare_numbers_of_ranks(&t);
}

TEST("rows and blocks that belong to a sample come from the rank that has the sample") {
    regression r = make_regression();
    trained t = training(&r, "lm", 12);
    t.options.validation = 0;
    own_training(&t, &r);
    compare_numbers_of_ranks(&t);
}

TEST("a matrix with several blocks of rows is divided, saved as a whole and resumed with another number "
     "of ranks") {
    static const char *const plans[] = {"adam", "ssbroyden", "lbfgs", "lm"};
    regression r = make_regression();
    for (size_t i = 0; i < LG_COUNT(plans); i++) {
        trained whole = training(&r, plans[i], 24), first = whole, rest = whole;
        const memory_archive expected = trained_by(&whole, 0, LG_OK);
        first.options.stop_after = 11;
        for (uint32_t a = 1; a <= 3; a += 2)
            for (uint32_t b = 2; b <= 4; b += 2) {
                memory_archive half = trained_by(&first, a, LG_OK);
                rest.from = &half;
                const memory_archive resumed = trained_by(&rest, b, LG_OK);
                assert_same_state(&expected, &resumed);
            }
    }
}

TEST("every rank ends with the same parameters") {
    regression r = make_regression();
    trained t = training(&r, "ssbroyden", 40);
    for (uint32_t k = 0; k < 4; k++) t.last[k] = TEST_ARRAY(double, t.problem.parameters);
    (void)trained_by(&t, 4, LG_OK);
    for (uint32_t k = 1; k < 4; k++)
        assert_memory_equal(t.last[0], t.last[k], t.problem.parameters * sizeof(double));
}

TEST("the cancel flag of one rank stops all ranks at the end of a batch, and resumed they reach the same "
     "bits") {
    static const char *const plans[] = {"adam", "ssbroyden"};
    regression r = make_regression();
    const int yes = 1;
    for (size_t i = 0; i < LG_COUNT(plans); i++) {
        trained whole = training(&r, plans[i], 9), first = whole, rest = whole;
        const memory_archive expected = trained_by(&whole, 0, LG_OK);
        first.cancel[2] = &yes;
        memory_archive none = trained_by(&first, 3, LG_CANCELLED);
        rest.from = &none;
        const memory_archive resumed = trained_by(&rest, 2, LG_OK);
        assert_same_state(&expected, &resumed);
    }
}

TEST("a sample that cannot be trained on fails all ranks, with the message of the rank that has it") {
    regression r = make_regression();
    rank_team *team = TEST_ARRAY(rank_team, 1);
    trained t = training(&r, "adam", 3);
    memory_archive to = {.count = 0};
    r.poison = 40;
    t.to = &to;
    t.options.shuffle = false;
    t.options.validation = 0;
    t.options.batch = 0;
    team_run(team, 3, train_rank, &t);
    for (uint32_t k = 0; k < 3; k++) {
        assert_int_equal(team->members[k].status, LG_NOT_FINITE);
        assert_string_equal(team->members[k].error.message, team->members[0].error.message);
        assert_message(&team->members[k].error, "epoch 1, batch 1: the loss is NaN");
    }
}

static lg_status broken_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                             size_t batch, lg_var *loss) {
    LG_TRY(regression_loss(user, tape, theta, samples, count, batch, loss));
    for (size_t i = 0; i < count; i++)
        if (samples[i] == 50) *loss = lg_matmul(tape, theta, theta); /* shapes that do not fit */
    return LG_OK;
}

TEST("an error of the loss on one rank is returned by all ranks, with the operation") {
    regression r = make_regression();
    rank_team *team = TEST_ARRAY(rank_team, 1);
    trained t = training(&r, "lbfgs", 3);
    memory_archive to = {.count = 0};
    t.to = &to;
    t.problem.loss = broken_loss;
    t.options.validation = 0;
    team_run(team, 4, train_rank, &t);
    for (uint32_t k = 0; k < 4; k++) {
        assert_int_equal(team->members[k].status, LG_SHAPE);
        assert_message(&team->members[k].error, "shard 3: matmul");
    }
}

/* ---- division of work, common errors ---- */

TEST("the ranks' parts of a total are contiguous and complete, and their sizes differ by at most one") {
    for (uint32_t count = 1; count < 12; count++)
        for (size_t total = 0; total < 40; total++) {
            size_t before = 0, first, end;
            for (uint32_t rank = 0; rank < count; rank++) {
                lg_ranks_part(rank, count, total, &first, &end);
                assert_int_equal(first, before);
                assert_true(end - first >= total / count && end - first <= total / count + 1);
                before = end;
            }
            assert_int_equal(before, total);
        }
}

static lg_status disagree(void *user, const lg_ranks *ranks, lg_error *error) {
    const uint32_t from = *(const uint32_t *)user;
    if (ranks->rank < from) return lg_ranks_agree(ranks, LG_OK, error);
    (void)snprintf(error->message, sizeof error->message, "no room on %u", ranks->rank);
    return lg_ranks_agree(ranks, LG_OUT_OF_MEMORY, error);
}

static lg_status refuse(void *user, void *all, const size_t *bytes) {
    return LG_FILE;
}

static const char *tell(void *user) {
    return user;
}

TEST("an exchange that fails says why, if the ranks know it") {
    lg_ranks ranks = {sizeof ranks, 0, 2, "rank 1 is silent", refuse, NULL, tell};
    lg_error error = {LG_OK, ""};
    assert_int_equal(lg_ranks_agree(&ranks, LG_OK, &error), LG_FILE);
    assert_message(&error, "rank 1 is silent");
    ranks.reason = NULL;
    assert_int_equal(lg_ranks_agree(&ranks, LG_OK, &error), LG_FILE);
    assert_message(&error, "the ranks lost their connection");
}

TEST("if several ranks fail, all return the error of the lowest rank") {
    rank_team *team = TEST_ARRAY(rank_team, 1);
    uint32_t from = 2;
    team_run(team, 4, disagree, &from);
    for (uint32_t k = 0; k < 4; k++) {
        assert_int_equal(team->members[k].status, LG_OUT_OF_MEMORY);
        assert_message(&team->members[k].error, "no room on 2");
    }
    from = 4;
    team_run(team, 4, disagree, &from);
    for (uint32_t k = 0; k < 4; k++) assert_int_equal(team->members[k].status, LG_OK);
}

/* ---- memory ---- */

/* Trains many times; each time another allocation of one rank fails, alone or with all later allocations. If
 * the rank has begun to exchange messages, it has to tell the other ranks. */
static void fail_allocations(trained *t, uint32_t rank, bool later, const memory_archive *expected) {
    lg_fail_alloc memory;
    rank_team *team = TEST_ARRAY(rank_team, 1);
    t->memory[rank] = &memory;
    for (long n = 1;; n++) {
        memory_archive to = {.count = 0};
        t->to = &to;
        (later ? lg_fail_alloc_arm_end : lg_fail_alloc_arm)(&memory, n);
        team_run(team, RANKS, train_rank, t);
        const bool hit = lg_fail_alloc_hit(&memory);
        if (!hit) assert_same_state(expected, &to);
        for (uint32_t k = 0; k < RANKS; k++) {
            const lg_status told_of = k == rank || team->meetings > 0 ? LG_OUT_OF_MEMORY : LG_FILE;
            if (team->members[k].status != (hit ? told_of : LG_OK))
                fail_msg("allocation %ld of rank %u, rank %u: %d, %s", n, rank, k,
                         (int)team->members[k].status, team->members[k].error.message);
        }
        assert_int_equal(lg_fail_alloc_live(&memory), 0);
        if (!hit) break;
    }
    t->memory[rank] = NULL;
}

TEST("if an allocation of a rank fails, all ranks end, and say so; or the result is right") {
    regression r = make_regression();
    trained t = training(&r, "adam:2,ssbroyden:4,lm:2", 8);
    t.options.shards = 4;
    const memory_archive expected = trained_by(&t, 0, LG_OK);
    for (uint32_t rank = 0; rank < 2; rank++)
        for (int later = 0; later < 2; later++) fail_allocations(&t, rank, later != 0, &expected);
}
