/* lg-simulate merge: the parts of an ensemble become one file. */
#include "lg-simulate/ensemble.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static merge_values values;

static const lg_field options[] = {
    LG_OPTION(merge_values, plot, STRING, "FILE.svg|.png", "Draw the bands of quantiles over time"),
    LG_OPTION(merge_values, statistics_only, SWITCH, NULL, "Leave the trajectories of --save out"),
    LG_FIELD_END};

typedef struct part {
    result is;
    uint64_t members; /* its own, which `is` counts with those of others once they are merged */
    const char *path;
} part;

static int by_first(const void *a, const void *b) {
    const part *x = a, *y = b;
    if (x->is.first != y->is.first) return x->is.first < y->is.first ? -1 : 1;
    return x->members < y->members ? -1 : x->members > y->members; /* those without members first */
}

typedef struct part_list {
    size_t count;
    part *parts; /* in the order of their members */
    size_t given_count;
    const char **given; /* files of trajectories among the arguments */
    size_t row_count;
    lg_rows_part *rows; /* those of the parts */
    uint64_t dim;
} part_list;

/* Together they are the whole ensemble, each member once. */
static int check_whole(const app *self, const part_list *list) {
    uint64_t next = 0;
    for (size_t i = 0; i < list->count; i++) {
        const uint64_t first = list->parts[i].is.first;
        if (first != next)
            return app_fail(self, LG_FORMAT, "members %llu to %llu are %s",
                            (unsigned long long)(first < next ? first : next),
                            (unsigned long long)(first < next ? next : first) - 1,
                            first < next ? "there twice" : "missing");
        next += list->parts[i].is.members;
    }
    if (next == list->parts[0].is.total) return APP_EXIT_OK;
    return app_fail(self, LG_FORMAT, "members %llu to %llu are missing", (unsigned long long)next,
                    (unsigned long long)list->parts[0].is.total - 1);
}

enum { RUN_SIZE = 4096 };

/* A pattern of parts finds their trajectories, too. */
static bool is_rows(const app *self, const char *path) {
    lg_rows_about about;
    return strstr(path, ".trajectories") != NULL &&
           lg_rows_file_look(self->context, path, &about, NULL, 0, NULL) == LG_OK;
}

static int read_parts(const app *self, part_list *list, const char *const *paths, size_t count) {
    lg_error error = {LG_OK, ""};
    for (size_t i = 0; i < count; i++) {
        const char *path = paths[i];
        if (is_rows(self, path)) {
            list->given[list->given_count++] = path;
            continue;
        }
        part *next = &list->parts[list->count];
        const lg_status status = result_read(self, path, &next->is, &error);
        if (status != LG_OK) return app_fail_file(self, status, &error, path);
        next->path = path;
        next->members = next->is.members;
        list->count++;
    }
    if (list->count == 0) return app_usage(self, "there are trajectories, but no part of an ensemble");
    qsort(list->parts, list->count, sizeof *list->parts, by_first);
    return APP_EXIT_OK;
}

/* ---- trajectories ---- */

#define WITHOUT "; --statistics-only merges without trajectories"

static bool same_folder(const char *a, const char *b) {
    const char *const paths[] = {a, b};
    char *folders[2];
    for (int i = 0; i < 2; i++) {
        const char *slash = strrchr(paths[i], '/');
        folders[i] = app_format("%.*s.", slash != NULL ? (int)(slash + 1 - paths[i]) : 0, paths[i]);
    }
    const bool same = app_same_file(folders[0], folders[1]);
    for (int i = 0; i < 2; i++) free(folders[i]);
    return same;
}

/* The file is that of this part and this run, and lies where the merged file will look for it. */
static int check_rows(const app *self, const part *of, const char *path, const char *out,
                      lg_rows_about *about) {
    lg_error error = {LG_OK, ""};
    const uint64_t rows = rows_among(of->is.saved, of->is.first, of->members);
    if (access(path, F_OK) != 0)
        return app_fail(self, LG_FILE, "%s: is missing: %s was run with --save" WITHOUT, path, of->path);
    char *run = app_alloc(RUN_SIZE, 1);
    const lg_status status = lg_rows_file_look(self->context, path, about, run, RUN_SIZE, &error);
    const bool same = status == LG_OK && strcmp(run, of->is.what) == 0;
    int code = APP_EXIT_OK;
    if (status != LG_OK)
        code = app_fail_file(self, status, &error, path);
    else if (!same)
        code = app_fail(self, LG_FORMAT, "%s: holds trajectories of another run than %s: %s" WITHOUT, path,
                        of->path, run);
    else if (about->first != of->is.first || about->rows != rows || about->points != of->is.points)
        code = app_fail(self, LG_FORMAT,
                        "%s: holds %llu members from %llu on, but those of %s are %llu from %llu on" WITHOUT,
                        path, (unsigned long long)about->rows, (unsigned long long)about->first, of->path,
                        (unsigned long long)rows, (unsigned long long)of->is.first);
    else if (!same_folder(path, out))
        code = app_fail(self, LG_FILE,
                        "%s: does not lie in the folder of %s, which would refer to it" WITHOUT, path, out);
    free(run);
    return code;
}

static int find_rows(const app *self, part_list *list, const char *out) {
    int code = APP_EXIT_OK;
    for (size_t i = 0; i < list->count && code == APP_EXIT_OK; i++) {
        const part *of = &list->parts[i], *first = &list->parts[0];
        lg_rows_about about = {0};
        if (of->is.saved != first->is.saved)
            return app_fail(
                self, LG_FORMAT,
                "%s keeps the trajectories of %llu members of the ensemble, %s those of %llu" WITHOUT,
                first->path, (unsigned long long)first->is.saved, of->path, (unsigned long long)of->is.saved);
        if (rows_among(of->is.saved, of->is.first, of->members) == 0) continue;
        char *path = rows_path(of->path);
        code = check_rows(self, of, path, out, &about);
        if (code == APP_EXIT_OK && list->row_count > 0 && about.dim != list->dim)
            code = app_fail(self, LG_FORMAT, "%s: holds states of another length", path);
        list->dim = about.dim;
        list->rows[list->row_count++] = (lg_rows_part){path, about.rows};
    }
    return code;
}

/* What nothing refers to was left by an earlier run. */
static void tell_of_unused(const app *self, const part_list *list) {
    for (size_t i = 0; i < list->given_count; i++) {
        bool used = false;
        for (size_t k = 0; k < list->row_count && !used; k++)
            used = app_same_file(list->given[i], list->rows[k].path);
        if (!used) app_warn(self, "%s: trajectories of no part that was given: left out", list->given[i]);
    }
}

/* ---- merging ---- */

static int merge_list(const app *self, const char *out, part_list *list, const merge_values *how) {
    lg_error error = {LG_OK, ""};
    result *whole = &list->parts[0].is;
    int code = check_whole(self, list);
    lg_status status = LG_OK;
    for (size_t i = 1; code == APP_EXIT_OK && i < list->count && status == LG_OK; i++)
        status = result_merge(whole, &list->parts[i].is, &error);
    if (code == APP_EXIT_OK && status != LG_OK) code = app_fail_file(self, status, &error, out);
    if (code == APP_EXIT_OK && !how->statistics_only) {
        code = find_rows(self, list, out);
        if (code == APP_EXIT_OK) tell_of_unused(self, list);
    }
    if (code != APP_EXIT_OK) return code;
    const result_rows rows = {list->rows, list->row_count, list->dim};
    if (how->statistics_only) whole->saved = 0;
    status = result_write(self, out, whole, list->row_count > 0 ? &rows : NULL, &error);
    if (status == LG_OK && how->plot != NULL) status = ensemble_draw(self, whole, how->plot, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, out);
    return ensemble_conclude(self, &(ensemble_run){whole, NULL, out});
}

int merge_parts(const app *self, const char *out, const char *const *paths, size_t count,
                const merge_values *how) {
    part_list list = {.count = 0};
    list.parts = app_alloc(count, sizeof *list.parts);
    list.given = app_alloc(count, sizeof *list.given);
    list.rows = app_alloc(count, sizeof *list.rows);
    int code = read_parts(self, &list, paths, count);
    if (code == APP_EXIT_OK) code = merge_list(self, out, &list, how);
    for (size_t i = 0; i < list.count; i++) result_free(&list.parts[i].is);
    for (size_t i = 0; i < list.row_count; i++) free((void *)(uintptr_t)list.rows[i].path);
    free(list.parts);
    free((void *)list.given);
    free(list.rows);
    return code;
}

static int run(app *self) {
    /* The first argument is written, the others are read. */
    const char *out = self->arguments[0];
    self->argument_count--;
    memmove((void *)self->arguments, self->arguments + 1,
            (size_t)self->argument_count * sizeof *self->arguments);
    const app_path paths[] = {{NULL, out, LG_FILE_WRITTEN}, {"plot", values.plot, LG_FILE_DRAWN}};
    const int code = app_check_outputs(self, paths, LG_COUNT(paths));
    if (code != APP_EXIT_OK) return code;
    return merge_parts(self, out, self->arguments, (size_t)self->argument_count, &values);
}

int merge_main(int argc, char **argv) {
    static const app_settings settings[] = {APP_GIVEN(options, values), APP_SETTINGS_END};
    static const app_command command[] = {
        {.name = "merge",
         .arguments = "OUT.h5 PART.h5...",
         .summary =
             "Merges the parts of an ensemble that --task wrote: the statistics are those of one process.",
         .settings = settings,
         .run = run},
        {.name = NULL}};
    return app_main(argc, argv, "lg-simulate", command[0].summary, command);
}
