/* lg-simulate merge: the parts of an ensemble become one file. */
#include "lg-simulate/ensemble.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct merge_values {
    const char *plot;
} merge_values;

static merge_values values;

static const app_option options[] = {
    APP_ROW_TEXT(merge_values, plot, "plot", "FILE.svg|.png", "Draw the bands of quantiles over time"),
    APP_ROW_END};

/* "out.part-3-of-8.h5" -> "out.part-3-of-8.trajectories.h5" */
static char *rows_name(const char *part) {
    const char *dot = strrchr(part, '.'), *slash = strrchr(part, '/');
    const int stem =
        (int)(dot != NULL && (slash == NULL || dot > slash) ? dot - part : (ptrdiff_t)strlen(part));
    return app_format("%.*s.trajectories%s", stem, part, part + stem);
}

typedef struct part {
    result is;
    const char *path;
} part;

static int by_first(const void *a, const void *b) {
    const part *x = a, *y = b;
    return x->is.first < y->is.first ? -1 : x->is.first > y->is.first;
}

typedef struct part_list {
    size_t count;
    part *parts; /* in the order of their members */
    char **rows; /* files of trajectories beside them */
    size_t row_count;
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

static int read_parts(const app *self, part_list *list, const char *const *paths, size_t count) {
    lg_error error = {LG_OK, ""};
    for (size_t i = 0; i < count; i++) {
        const char *path = paths[i];
        const lg_status status = result_read(self, path, &list->parts[list->count].is, &error);
        if (status != LG_OK) return app_fail_file(self, status, &error, path);
        list->parts[list->count++].path = path;
    }
    qsort(list->parts, list->count, sizeof *list->parts, by_first);
    return APP_EXIT_OK;
}

static void find_rows(part_list *list) {
    for (size_t i = 0; i < list->count; i++) {
        char *name = rows_name(list->parts[i].path);
        if (access(name, R_OK) == 0)
            list->rows[list->row_count++] = name;
        else
            free(name);
    }
}

int merge_parts(const app *self, const char *out, const char *const *paths, size_t count, const char *plot) {
    lg_error error = {LG_OK, ""};
    part_list list = {.count = 0};
    list.parts = app_alloc(count, sizeof *list.parts);
    list.rows = app_alloc(count, sizeof *list.rows);
    int code = read_parts(self, &list, paths, count);
    if (code == APP_EXIT_OK) code = check_whole(self, &list);
    lg_status status = LG_OK;
    for (size_t i = 1; code == APP_EXIT_OK && i < list.count && status == LG_OK; i++)
        status = result_merge(&list.parts[0].is, &list.parts[i].is, &error);
    if (code == APP_EXIT_OK && status == LG_OK) {
        find_rows(&list);
        status = result_write(self, out, &list.parts[0].is, (const char *const *)list.rows, list.row_count,
                              &error);
    }
    if (code == APP_EXIT_OK && status == LG_OK && plot != NULL)
        status = ensemble_draw(self, &list.parts[0].is, plot, &error);
    if (code == APP_EXIT_OK && status != LG_OK) code = app_fail_file(self, status, &error, out);
    const ensemble_run shown = {&list.parts[0].is, NULL, out};
    if (code == APP_EXIT_OK && self->json) ensemble_json(self, &shown);
    if (code == APP_EXIT_OK && !self->json) ensemble_text(&shown);
    for (size_t i = 0; i < list.count; i++) result_free(&list.parts[i].is);
    for (size_t i = 0; i < list.row_count; i++) free(list.rows[i]);
    free(list.parts);
    free(list.rows);
    return code;
}

static int run(app *self) {
    const app_path paths[] = {{"plot", values.plot, APP_DRAWN}};
    const int code = app_check_outputs(self, paths, LG_COUNT(paths));
    if (code != APP_EXIT_OK) return code;
    return merge_parts(self, self->arguments[0], self->arguments + 1, (size_t)self->argument_count - 1,
                       values.plot);
}

int merge_main(int argc, char **argv) {
    static const app_command command[] = {
        {.name = "merge",
         .arguments = "OUT.h5 PART.h5...",
         .summary =
             "Merges the parts of an ensemble that --task wrote: the statistics are those of one process.",
         .options = options,
         .values = &values,
         .arguments_min = 2,
         .arguments_max = APP_ARGUMENTS,
         .run = run},
        {.name = NULL}};
    return app_main(argc, argv, "lg-simulate", command[0].summary, command);
}
