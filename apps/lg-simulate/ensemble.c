#include "common/train.h"
#include "lg-simulate/ensemble.h"
#include "mechanics/system.h"

#include <errno.h>
#include <math.h>
#include <stdatomic.h>
#include <string.h>

enum { POINTS = 51, BINS = 256, PILOT = 256, LOOKED_AT = 8 };

/* ---- what a thread collects ---- */

typedef struct gatherer {
    result part;               /* the thread's own accumulators */
    double *invariant, *start; /* (invariants, room) for the members of a block: now, and at the start */
    double *row;               /* (points, reported): the trajectory of a member */
    double *state, *work;
    lg_system *system; /* has the member's parameters; NULL if parameters do not vary */
    simulation sim;    /* of this system */
    watch seen;        /* of the member */
} gatherer;

typedef struct study {
    simulation *sim;
    const ensemble_files *files;
    result *total;
    vary *varied;
    lg_ensemble_options options;
    size_t invariants;
    gatherer *gatherers;
    uint64_t saved; /* trajectories are kept for members 0 .. saved - 1 */
    lg_rows_file *rows;
    atomic_int rows_lost; /* errno of the first row that could not be written; the statistics continue */
    atomic_ullong done;
    app_progress progress;
} study;

/* Names the columns: the numbers of the state, then for each invariant its value and the size of its
 * drift. */
static void name_columns(study *all) {
    const simulation *sim = all->sim;
    result *total = all->total;
    total->columns = sim->reported + 2 * all->invariants;
    total->column = app_keep(total->columns, sizeof *total->column);
    for (size_t c = 0; c < sim->reported; c++) component_name(sim, c, total->column[c], NAME_SIZE);
    for (size_t i = 0; i < all->invariants; i++) {
        const char *name = lg_system_invariant_name(sim->system, i);
        (void)snprintf(total->column[sim->reported + 2 * i], NAME_SIZE, "%s", name);
        (void)snprintf(total->column[sim->reported + 2 * i + 1], NAME_SIZE, "drift of %s", name);
    }
}

/* Called as visit(user, row, column, values, count) for each cell (row, column); values (count) are the
 * cell's numbers of all members of a block. */
typedef void (*cell_visitor)(void *user, size_t row, size_t column, const double *values, size_t count);

/* Gives the gatherer the parameters of a member of a block. */
static void set_member(gatherer *own, const lg_ensemble_block *of, size_t m) {
    double *parameters = own->row; /* scratch memory, which is long enough */
    if (own->system == NULL) return;
    for (size_t i = 0; i < of->parameter_count; i++) parameters[i] = of->parameter[i * of->room + m];
    (void)lg_system_set_parameters(own->system, parameters);
}

/* Member m of numbers (dim, room). */
static const double *state_of(gatherer *own, const lg_ensemble_block *of, const double *numbers, size_t m) {
    for (size_t c = 0; c < of->dim; c++) own->state[c] = numbers[c * of->room + m];
    return own->state;
}

/* Computes the invariants of all members of a block at this row. */
static void fill_invariants(const study *all, gatherer *own, const lg_ensemble_block *of, size_t row) {
    for (size_t m = 0; m < of->members; m++) {
        const double *state = state_of(own, of, of->states + row * of->dim * of->room, m);
        set_member(own, of, m);
        for (size_t i = 0; i < all->invariants; i++)
            own->invariant[i * of->room + m] = lg_system_invariant(own->sim.system, i, state, own->work);
    }
}

/* Counts members that leave the manifold, and members whose energy changes: looks at the end of each member
 * and at some of the rows before it. */
static void watch_block(const study *all, gatherer *own, const lg_ensemble_block *of) {
    const size_t stride = 1 + (of->count - 1) / LOOKED_AT;
    for (size_t m = 0; m < of->members; m++) {
        if (of->member[m].status != LG_OK) continue;
        set_member(own, of, m);
        watch_again(&own->seen, state_of(own, of, of->start, m));
        for (size_t back = 1; back <= of->count; back += stride)
            (void)watch_step(&own->seen, 0, 0,
                             state_of(own, of, of->states + (of->count - back) * of->dim * of->room, m));
        own->part.left += watch_left_manifold(&own->seen);
        own->part.lost += watch_lost_energy(&own->seen, all->options.scheme);
    }
}

static void visit_cells(const study *all, gatherer *own, const lg_ensemble_block *of, cell_visitor visit,
                        void *user) {
    const size_t reported = all->sim->reported, room = of->room;
    for (size_t row = 0; row < of->count; row++) {
        for (size_t c = 0; c < reported; c++)
            visit(user, row, c, of->states + (row * of->dim + c) * room, of->members);
        if (all->invariants > 0) fill_invariants(all, own, of, row);
        for (size_t i = 0; i < all->invariants; i++) {
            double *value = own->invariant + i * room, *start = own->start + i * room;
            if (row == 0) memcpy(start, value, of->members * sizeof *start);
            visit(user, row, reported + 2 * i, value, of->members);
            for (size_t m = 0; m < of->members; m++) value[m] = fabs(value[m] - start[m]);
            visit(user, row, reported + 2 * i + 1, value, of->members);
        }
    }
}

static void set_range(void *user, size_t row, size_t column, const double *values, size_t count) {
    lg_statistics *states = user;
    const lg_statistics_range range = lg_statistics_range_of(states, column, values, count);
    lg_statistics_set_range(states, row, column, &range);
}

static void add_cell(void *user, size_t row, size_t column, const double *values, size_t count) {
    lg_statistics_add(user, row, column, values, count);
}

static lg_status keep_ranges(void *user, const lg_ensemble_block *of) {
    study *all = user;
    visit_cells(all, &all->gatherers[of->thread], of, set_range, all->total->states);
    for (size_t e = 0; e < of->event_count; e++) {
        lg_statistics *times = all->total->times;
        const double *values = of->events + e * of->room;
        const double centre = lg_statistics_range_of(times, e, values, of->members).centre;
        lg_statistics_set_range(times, 0, e, &(lg_statistics_range){0.0, all->sim->t_end, centre});
    }
    return LG_OK;
}

static lg_status save_rows(study *all, gatherer *own, const lg_ensemble_block *of) {
    const size_t reported = all->sim->reported;
    lg_status status = LG_OK;
    if (atomic_load(&all->rows_lost) != 0) return LG_OK;
    for (size_t m = 0; m < of->members && of->first + m < all->saved && status == LG_OK; m++) {
        for (size_t row = 0; row < of->count; row++)
            for (size_t c = 0; c < reported; c++)
                own->row[row * reported + c] = of->states[(row * of->dim + c) * of->room + m];
        status = lg_rows_file_put(all->rows, of->first + m - all->total->first, own->row);
    }
    if (status != LG_FILE) return status;
    atomic_store(&all->rows_lost, errno);
    return LG_OK;
}

static lg_status keep_block(void *user, const lg_ensemble_block *of) {
    study *all = user;
    gatherer *own = &all->gatherers[of->thread];
    result *part = &own->part;
    visit_cells(all, own, of, add_cell, part->states);
    watch_block(all, own, of);
    for (size_t e = 0; e < of->event_count; e++)
        lg_statistics_add(part->times, 0, e, of->events + e * of->room, of->members);
    for (size_t m = 0; m < of->members; m++) {
        const lg_ensemble_member *member = &of->member[m];
        part->steps += member->steps;
        part->rejected += member->rejected;
        if (member->status == LG_OK) continue;
        part->failed[(size_t)member->status < STATUSES ? (size_t)member->status : STATUSES - 1]++;
        result_list(part, of->first + m, (uint64_t)member->status, member->reached);
    }
    part->members += of->members;
    const unsigned long long done = atomic_fetch_add(&all->done, of->members) + of->members;
    if (of->thread == 0) app_progress_show(&all->progress, done, "%llu members", done);
    return all->rows != NULL ? save_rows(all, own, of) : LG_OK;
}

/* ---- options ---- */

/* Reads NAME=VALUE, NAME>VALUE or NAME<VALUE: the event that a number of the state passes the value in any
 * direction, upwards, or downwards. */
static void read_event(const simulation *sim, char *text, lg_ensemble_event *event, column_name name) {
    char *sign = strpbrk(text, "=<>");
    size_t index = 0;
    double level = 0;
    (void)snprintf(name, NAME_SIZE, "%s", trimmed(text));
    const char kind = sign != NULL ? *sign : '\0';
    if (sign != NULL) *sign = '\0';
    if (sign == NULL || lg_number_parse(trimmed(sign + 1), &level) != LG_OK)
        app_stop_usage(sim->self, "--event: expected NAME=VALUE, NAME>VALUE or NAME<VALUE, not '%s'", name);
    text = trimmed(text);
    if (!component_find(sim, text, &index) || index >= sim->dim) {
        char own[NAME_SIZE];
        component_name(sim, 0, own, sizeof own);
        app_stop_usage(sim->self,
                       "--event: '%s' is not a number of the state %s; the first number is called %s", text,
                       lg_system_layout(sim->system), own);
    }
    *event = (lg_ensemble_event){.terms = 1,
                                 .index = {index},
                                 .weight = {1.0},
                                 .level = level,
                                 .direction = kind == '>'   ? 1
                                              : kind == '<' ? -1
                                                            : 0};
}

static void read_events(study *all, lg_ensemble_event events[LG_EVENTS_MAX]) {
    const simulation *sim = all->sim;
    if (sim->values->event == NULL) return;
    APP_FREE char *copy = app_format("%s", sim->values->event);
    all->total->event = app_keep(LG_EVENTS_MAX, sizeof *all->total->event);
    for (char *rest = copy, *item; (item = strtok_r(rest, ",", &rest)) != NULL;) {
        const size_t e = all->total->events++;
        if (e == LG_EVENTS_MAX)
            app_stop_usage(sim->self, "--event: at most %d events can be given", LG_EVENTS_MAX);
        read_event(sim, item, &events[e], all->total->event[e]);
    }
    all->options.events = events;
    all->options.event_count = all->total->events;
}

/* Draws the start and, behind it, the parameters of a member. */
static void draw(const study *all, uint64_t member, double *y0) {
    const simulation *sim = all->sim;
    double *parameters = y0 + sim->dim;
    memset(y0, 0, sim->dim * sizeof *y0);
    if (sim->scene.state != NULL) memcpy(y0, sim->scene.state, sim->dim * sizeof *y0);
    memcpy(parameters, lg_system_parameter_values(sim->system),
           lg_system_parameter_count(sim->system) * sizeof *parameters);
    (void)vary_draw(all->varied, member, y0, parameters);
}

/* Describes the ensemble in one line; parts with the same line belong together. Long texts are cut in the
 * line, but the hash covers them completely. */
static char *describe(const study *all, const char *text) {
    enum { LONGEST = 4096, MEMBERS = 64 };
    char *out = app_keep(LONGEST, 1);
    const simulation *sim = all->sim;
    const lg_ensemble_options *o = &all->options;
    lg_sha256 state;
    char hash[LG_SHA256_TEXT];
    const double control[] = {o->control.rtol, o->control.atol, (double)o->steps,
                              (double)o->control.max_steps, o->scheme->theta};
    const char *starts = sim->values->members, *event = sim->values->event;
    lg_sha256_init(&state);
    lg_sha256_add(&state, text, strlen(text));
    if (starts != NULL) lg_sha256_add(&state, starts, strlen(starts));
    if (event != NULL) lg_sha256_add(&state, event, strlen(event));
    /* Starts and parameters of up to 64 members, which depend on tables and the scene too. */
    const size_t count = lg_system_parameter_count(sim->system);
    const uint64_t total = all->total->total, step = total > MEMBERS ? total / MEMBERS : 1;
    APP_FREE double *y0 = app_alloc(sim->dim + count, sizeof *y0);
    for (uint64_t i = 0; i < MEMBERS && i * step < total; i++) {
        draw(all, i * step, y0);
        lg_sha256_add(&state, y0, (sim->dim + count) * sizeof *y0);
    }
    lg_sha256_add(&state, lg_system_parameter_values(sim->system), count * sizeof(double));
    if (sim->scene.state != NULL) lg_sha256_add(&state, sim->scene.state, sim->dim * sizeof(double));
    lg_sha256_add(&state, all->total->t, all->total->points * sizeof(double));
    lg_sha256_add(&state, control, sizeof control);
    lg_sha256_add(&state, o->scheme->a, sizeof o->scheme->a);
    lg_sha256_add(&state, o->scheme->b, sizeof o->scheme->b);
    lg_sha256_add(&state, &o->scheme->dexpinv, sizeof o->scheme->dexpinv);
    lg_sha256_finish(&state, hash);
    (void)snprintf(
        out, LONGEST, "%s %s, %s, %llu members, seed %llu, vary %.1000s%s%.500s%s%.500s, sha256 %.16s",
        lg_system_name(sim->system), lg_system_form(sim->system) != NULL ? lg_system_form(sim->system) : "",
        o->scheme->name, (unsigned long long)all->total->total, (unsigned long long)sim->self->seed,
        text[0] != '\0' ? text : "nothing", starts != NULL ? ", starts " : "", starts != NULL ? starts : "",
        event != NULL ? ", events " : "", event != NULL ? event : "", hash);
    return out;
}

/* ---- running ---- */

static void open_gatherers(study *all) {
    const size_t threads = (size_t)all->options.threads, room = 1024;
    const size_t parameters = lg_system_parameter_count(all->sim->system);
    const size_t row = all->total->points * all->sim->reported;
    all->gatherers = app_keep(threads, sizeof *all->gatherers);
    for (size_t i = 0; i < threads; i++) {
        gatherer *own = &all->gatherers[i];
        own->invariant = app_keep(all->invariants * room, sizeof(double));
        own->start = app_keep(all->invariants * room, sizeof(double));
        own->row = app_keep(row > parameters ? row : parameters, sizeof(double));
        own->state = app_keep(all->sim->dim, sizeof(double));
        own->work = app_keep(lg_system_work_size(all->sim->system), 1);
        if (all->options.varied &&
            lg_system_copy(all->sim->self->context, all->sim->system, &own->system) != LG_OK)
            app_out_of_memory();
        own->sim = *all->sim;
        if (own->system != NULL) own->sim.system = own->system;
        watch_begin(&own->seen, &own->sim, false, false, own->state);
    }
}

static lg_status run(const study *all, const lg_ensemble_options *options, lg_ensemble_keep keep,
                     lg_ensemble_stats *stats, lg_error *error) {
    return lg_ensemble_run(all->sim->self->context, all->sim->system, options, vary_draw, all->varied, keep,
                           (void *)all, stats, error);
}

/* Runs the first members to choose the ranges of the histogram of each cell. */
static lg_status run_pilot(study *all, lg_error *error) {
    result *total = all->total;
    lg_ensemble_options pilot = all->options;
    const bool *logarithmic = result_logarithmic(total);
    lg_status status = lg_statistics_create(all->sim->self->context, total->points, total->columns, BINS,
                                            logarithmic, &total->states);
    if (status == LG_OK && total->events > 0)
        status = lg_statistics_create(all->sim->self->context, 1, total->events, BINS, NULL, &total->times);
    if (status != LG_OK)
        return lg_fail(error, status, "the statistics of %zu points could not be created",
                       (size_t)total->points);
    pilot.first = 0;
    pilot.members = total->total < PILOT ? total->total : PILOT;
    pilot.block = PILOT;
    pilot.threads = 1;
    return run(all, &pilot, keep_ranges, NULL, error);
}

static lg_status run_all(study *all, lg_ensemble_stats *stats, lg_error *error) {
    const size_t threads = (size_t)all->options.threads;
    lg_status status = run_pilot(all, error);
    for (size_t i = 0; i < threads && status == LG_OK; i++) {
        result *part = &all->gatherers[i].part;
        status = lg_statistics_create_like(all->total->states, &part->states);
        if (status == LG_OK && all->total->times != NULL)
            status = lg_statistics_create_like(all->total->times, &part->times);
        part->what = all->total->what;
    }
    app_progress_begin(&all->progress, 0, all->options.members);
    if (status == LG_OK) status = run(all, &all->options, keep_block, stats, error);
    app_progress_end(&all->progress);
    all->total->members = 0;
    for (size_t i = 0; i < threads && status == LG_OK; i++)
        status = result_merge(all->total, &all->gatherers[i].part, error);
    return status;
}

/* ---- files ---- */

static lg_status open_rows(study *all, lg_error *error) {
    const app *self = all->sim->self;
    const result *total = all->total;
    const lg_provenance provenance = app_provenance(self, self->seed);
    const lg_rows_options options = {.provenance = &provenance,
                                     .first = total->first,
                                     .rows = rows_among(all->saved, total->first, all->options.members),
                                     .points = total->points,
                                     .dim = all->sim->reported,
                                     .t = total->t,
                                     .layout = lg_system_layout(all->sim->system),
                                     .run = total->what};
    if (options.rows == 0) return LG_OK;
    return lg_rows_file_create(self->context, all->files->trajectories, &options, &all->rows, error);
}

/* Says how many members have wrong results, and what is wrong with the first that was not allowed. */
static void warn_of_members(const study *all) {
    const simulation *sim = all->sim;
    const app *self = sim->self;
    const result *what = all->total;
    size_t at = 0;
    if (what->left + what->lost > 0)
        app_warn(self,
                 "of %llu members %llu leave the manifold, and %llu change their energy, which is constant: "
                 "their results are far from the solution; give more --steps or a smaller --tolerance, or "
                 "cf4, which stays on the manifold",
                 (unsigned long long)what->members, (unsigned long long)what->left,
                 (unsigned long long)what->lost);
    while (at < what->listed && what->who[at][1] != LG_INVALID_ARGUMENT) at++;
    if (at == what->listed) return;
    lg_error error = {LG_OK, "its start is not finite or not on the manifold"};
    APP_FREE double *y0 = app_alloc(sim->dim + lg_system_parameter_count(sim->system), sizeof *y0);
    draw(all, what->who[at][0], y0);
    (void)lg_system_check_parameters(sim->system, y0 + sim->dim, &error);
    const unsigned long long member = what->who[at][0];
    const char *table = sim->values->members;
    APP_FREE char *row = table != NULL ? app_format(" (row %llu of %s)", member + 1, table) : NULL;
    app_warn(self, "member %llu%s is not allowed: %s", member, row != NULL ? row : "", error.message);
}

/* Runs the ensemble. A failure ends the command, and thereby all ranks. */
static void run_or_stop(study *all, lg_ensemble_stats *stats) {
    const app *self = all->sim->self;
    lg_error error = {LG_OK, ""};
    open_gatherers(all);
    lg_status status = all->files->trajectories != NULL ? open_rows(all, &error) : LG_OK;
    if (status == LG_OK) status = run_all(all, stats, &error);
    if (status == LG_OK) return;
    lg_rows_file_destroy(all->rows);
    if (status == LG_CANCELLED)
        app_stop(self, status, "stopped by %s: nothing was written, because the ensemble is not complete",
                 app_stopper());
    if (status == LG_FILE) app_must_file(self, status, &error, all->files->trajectories);
    app_must(self, status, &error);
}

/* Writes the results: the statistics also if the trajectories could not be written. */
static void write_out(study *all) {
    app *self = all->sim->self;
    const ensemble_files *files = all->files;
    result *total = all->total;
    lg_error lost = {LG_OK, ""};
    const bool kept = all->rows != NULL;
    const int code = atomic_load(&all->rows_lost);
    const lg_status status = !kept       ? LG_OK
                             : code == 0 ? lg_rows_file_commit(all->rows, &lost)
                                         : lg_fail(&lost, LG_FILE, "%s: cannot be written: %s",
                                                   files->trajectories, strerror(code));
    const lg_rows_part part = {files->trajectories,
                               rows_among(all->saved, total->first, all->options.members)};
    const result_rows rows = {&part, 1, all->sim->reported};
    lg_rows_file_destroy(all->rows);
    total->saved = status == LG_OK ? all->saved : 0;
    if (files->out != NULL)
        APP_MUST_FILE(self, files->out,
                      result_write(self, files->out, total, kept && status == LG_OK ? &rows : NULL, &error));
    if (self->ranks == NULL) app_plot_row(self, ensemble_plots, total);
    if (status == LG_OK) return;
    self->code = app_fail(self, status, "%s; the statistics are in %s", lost.message, files->out);
    if (self->ranks != NULL) app_end(self->code);
}

/* Waits until all ranks have written their parts; then rank 0 merges them into one file and prints the
 * results. */
static void merge_ranks(const study *all) {
    app *self = all->sim->self;
    const uint64_t tasks = all->files->task.count;
    const char *out = all->sim->values->out;
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_ranks_agree(self->ranks, LG_OK, &error);
    app_end_exchanges(self);
    app_must(self, status, &error);
    if (self->rank > 0) return;
    APP_FREE const char **parts = app_alloc(tasks, sizeof *parts);
    for (uint64_t i = 0; i < tasks; i++) parts[i] = part_path(out, &(ensemble_task){i, tasks});
    merge_parts(self, out, parts, tasks, false);
    for (uint64_t i = 0; i < tasks; i++) (void)remove(parts[i]);
}

/* ---- choosing what is run ---- */

static void prepare(study *all, const lg_scheme *scheme, const char *text, lg_ensemble_event *events) {
    const simulation *sim = all->sim;
    const simulate_values *values = sim->values;
    const ensemble_files *files = all->files;
    size_t rows;
    samples path;
    plan how;
    plan_init(sim, scheme, &how);
    lg_ensemble_options *o = &all->options;
    lg_ensemble_options_init(o);
    all->varied = vary_open(sim, text, values->members, &rows, &o->varied);
    o->threads = (int)sim->self->threads;
    o->scheme = scheme;
    o->steps = how.control.steps;
    o->control = how.control;
    o->start = sim->scene.state;
    all->total->total = values->ensemble;
    all->invariants = lg_system_invariants(sim->system);
    if (files->task.count > 0 && files->out == NULL)
        app_stop_usage(sim->self, values->task != NULL ? "--task: the part needs a file: give --out"
                                                       : "ranks of mpirun write parts: give --out");
    all->saved = values->save < values->ensemble ? values->save : values->ensemble;
    if (values->save > 0 && files->out == NULL)
        app_stop_usage(sim->self, "--save: trajectories need a file: give --out");
    read_events(all, events);
    samples_times(sim, POINTS, &path);
    o->times = all->total->t = path.t + path.first;
    o->count = all->total->points = path.count - path.first;
    if (rows > 0 && values->ensemble > rows)
        app_stop_usage(sim->self, "--members: %s has %zu rows, fewer than --ensemble %llu", values->members,
                       rows, (unsigned long long)values->ensemble);
    if (rows > values->ensemble)
        app_warn(sim->self, "--members: %s has %zu rows: only the first %llu are used", values->members, rows,
                 (unsigned long long)values->ensemble);
    /* Each task gets whole blocks. The size of a block depends on the scene and the options, not on the
     * number of tasks. */
    const uint64_t task = files->task.index, tasks = files->task.count > 0 ? files->task.count : 1,
                   size = lg_ensemble_block_size(o, sim->dim), total = all->total->total,
                   blocks = (total + size - 1) / size, to = blocks * (task + 1) / tasks * size;
    o->block = (size_t)(all->total->block = size);
    o->first = all->total->first = blocks * task / tasks * size;
    o->members = (to < total ? to : total) - o->first;
    name_columns(all);
}

static void study_close(study *all) {
    for (size_t i = 0; all->gatherers != NULL && i < (size_t)all->options.threads; i++) {
        lg_system_destroy(all->gatherers[i].system);
        result_free(&all->gatherers[i].part);
    }
    vary_close(all->varied);
    result_free(all->total);
}

void ensemble(simulation *sim, const ensemble_files *files) {
    const simulate_values *values = sim->values;
    const char *text = values->vary != NULL ? values->vary : sim->scene.ensemble;
    lg_ensemble_event events[LG_EVENTS_MAX];
    lg_ensemble_stats stats;
    result total = {.what = NULL};
    APP_CLEAN(method_free) method chosen = method_choose(sim);
    check_control(sim, &chosen.scheme);
    APP_CLEAN(study_close) study all = {.sim = sim, .files = files, .total = &total};
    prepare(&all, &chosen.scheme, text, events);
    if (text[0] == '\0' && values->members == NULL && sim->scene.has_initial)
        app_warn(
            sim->self,
            "all members are the same, because nothing varies; give --vary, --members or the key `ensemble`");
    total.what = describe(&all, text);
    run_or_stop(&all, &stats);
    warn_of_members(&all);
    write_out(&all);
    if (sim->self->ranks != NULL)
        merge_ranks(&all);
    else
        ensemble_conclude(sim->self, &total, &stats, files->out);
}
