/* lg-simulate merge: merges the parts of an ensemble into one file. */
#include "lg-simulate/ensemble.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct merge_values {
    bool statistics_only; /* trajectories are left out */
} merge_values;

static merge_values values;

static const lg_field options[] = {
    LG_OPTION(merge_values, statistics_only, SWITCH, NULL, "Leave the trajectories of --save out"),
    LG_FIELD_END};

typedef struct part {
    result is;
    uint64_t members; /* members of this part alone; is.members grows when other parts are merged into it */
    const char *path;
} part;

static int by_first(const void *a, const void *b) {
    const part *x = a, *y = b;
    if (x->is.first != y->is.first) return x->is.first < y->is.first ? -1 : 1;
    return x->members < y->members ? -1 : x->members > y->members; /* parts without members come first */
}

typedef struct part_list {
    size_t count;
    part *parts; /* in the order of their members */
    size_t given_count;
    const char **given; /* files of trajectories among the arguments */
    size_t row_count;
    lg_rows_part *rows; /* the trajectories of the parts */
    uint64_t dim;
} part_list;

/* Checks that the parts together have each member of the ensemble exactly once. */
static void check_whole(const app *self, const part_list *list) {
    uint64_t next = 0;
    for (size_t i = 0; i < list->count; i++) {
        const uint64_t first = list->parts[i].is.first;
        if (first != next)
            app_stop(self, LG_FORMAT, "members %llu to %llu are %s",
                     (unsigned long long)(first < next ? first : next),
                     (unsigned long long)(first < next ? next : first) - 1,
                     first < next ? "there twice" : "missing");
        next += list->parts[i].is.members;
    }
    if (next != list->parts[0].is.total)
        app_stop(self, LG_FORMAT, "members %llu to %llu are missing", (unsigned long long)next,
                 (unsigned long long)list->parts[0].is.total - 1);
}

enum { RUN_SIZE = 4096 };

/* A pattern like out.part-* also matches the parts' trajectories. */
static void read_parts(const app *self, part_list *list, const char *const *paths, size_t count) {
    for (size_t i = 0; i < count; i++) {
        lg_rows_about about;
        if (strstr(paths[i], ".trajectories") != NULL &&
            lg_rows_file_look(self->context, paths[i], &about, NULL, 0, NULL) == LG_OK) {
            list->given[list->given_count++] = paths[i];
            continue;
        }
        part *next = &list->parts[list->count++];
        next->path = paths[i];
        APP_MUST_FILE(self, next->path, result_read(self, next->path, &next->is, &error));
        next->members = next->is.members;
    }
    if (list->count == 0)
        app_stop_usage(self, "only trajectories are given; give at least one part of an ensemble");
    qsort(list->parts, list->count, sizeof *list->parts, by_first);
}

/* ---- trajectories ---- */

#define WITHOUT "; --statistics-only merges without trajectories"

/* Checks that the file has the trajectories of this part and this run, and that it is in the folder of `out`,
 * where the merged file will refer to it. */
static lg_rows_about check_rows(const app *self, const part *of, const char *path, const char *out) {
    lg_rows_about about = {0};
    const uint64_t rows = rows_among(of->is.saved, of->is.first, of->members);
    if (access(path, F_OK) != 0)
        app_stop(self, LG_FILE, "%s: is missing: %s was run with --save" WITHOUT, path, of->path);
    APP_FREE char *run = app_alloc(RUN_SIZE, 1);
    APP_FILE(self, path, lg_rows_file_look, &about, run, RUN_SIZE);
    if (strcmp(run, of->is.what) != 0)
        app_stop(self, LG_FORMAT, "%s: holds trajectories of another run than %s: its run is %s" WITHOUT,
                 path, of->path, run);
    if (about.first != of->is.first || about.rows != rows || about.points != of->is.points)
        app_stop(
            self, LG_FORMAT,
            "%s: holds %llu members from number %llu on, but %s has %llu members from number %llu on" WITHOUT,
            path, (unsigned long long)about.rows, (unsigned long long)about.first, of->path,
            (unsigned long long)rows, (unsigned long long)of->is.first);
    APP_FREE char *folder = app_folder_of(path), *other = app_folder_of(out);
    if (!app_same_file(folder, other))
        app_stop(self, LG_FILE, "%s: must be in the folder of %s, which refers to it" WITHOUT, path, out);
    return about;
}

static void find_rows(const app *self, part_list *list, const char *out) {
    for (size_t i = 0; i < list->count; i++) {
        const part *of = &list->parts[i], *first = &list->parts[0];
        if (of->is.saved != first->is.saved)
            app_stop(self, LG_FORMAT,
                     "%s keeps the trajectories of %llu members of the ensemble, but %s keeps %llu" WITHOUT,
                     first->path, (unsigned long long)first->is.saved, of->path,
                     (unsigned long long)of->is.saved);
        if (rows_among(of->is.saved, of->is.first, of->members) == 0) continue;
        const char *path = rows_path(of->path);
        const lg_rows_about about = check_rows(self, of, path, out);
        if (list->row_count > 0 && about.dim != list->dim)
            app_stop(self, LG_FORMAT, "%s: holds states of another length", path);
        list->dim = about.dim;
        list->rows[list->row_count++] = (lg_rows_part){path, about.rows};
    }
    for (size_t i = 0; i < list->given_count; i++) { /* an earlier run may have left them */
        bool used = false;
        for (size_t k = 0; k < list->row_count && !used; k++)
            used = app_same_file(list->given[i], list->rows[k].path);
        if (!used)
            app_warn(self, "%s: these trajectories belong to none of the given parts and are left out",
                     list->given[i]);
    }
}

/* ---- merging ---- */

static void part_list_free(part_list *list) {
    for (size_t i = 0; i < list->count; i++) result_free(&list->parts[i].is);
}

void merge_parts(const app *self, const char *out, const char *const *paths, size_t count,
                 bool statistics_only) {
    APP_CLEAN(part_list_free) part_list list = {.count = 0};
    list.parts = app_keep(count, sizeof *list.parts);
    list.given = app_keep(count, sizeof *list.given);
    list.rows = app_keep(count, sizeof *list.rows);
    read_parts(self, &list, paths, count);
    check_whole(self, &list);
    result *whole = &list.parts[0].is;
    for (size_t i = 1; i < list.count; i++)
        APP_MUST_FILE(self, list.parts[i].path, result_merge(whole, &list.parts[i].is, &error));
    if (statistics_only)
        whole->saved = 0;
    else
        find_rows(self, &list, out);
    const result_rows rows = {list.rows, list.row_count, list.dim};
    APP_MUST_FILE(self, out, result_write(self, out, whole, list.row_count > 0 ? &rows : NULL, &error));
    app_plot_draw(self, 0, whole);
    ensemble_conclude(self, whole, NULL, out);
}

static void run(app *self) {
    /* The first argument is the output, the others are inputs. */
    const char *out = self->arguments[0];
    self->argument_count--;
    memmove((void *)self->arguments, self->arguments + 1,
            (size_t)self->argument_count * sizeof *self->arguments);
    app_check_outputs(self, &(app_path){NULL, out, LG_FILE_WRITTEN, "ensemble"}, 1);
    merge_parts(self, out, self->arguments, (size_t)self->argument_count, values.statistics_only);
}

int merge_main(int argc, char **argv) {
    const app_command command[] = {{.name = "merge",
                                    .arguments = "OUT.h5 PART.h5...",
                                    .summary = "Merges the parts of an ensemble that --task wrote. "
                                               "The statistics are the same as from one process.",
                                    .plots = ensemble_plots,
                                    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
                                    .run = run},
                                   {.name = NULL}};
    return app_main(argc, argv, "lg-simulate", command[0].summary, command);
}
