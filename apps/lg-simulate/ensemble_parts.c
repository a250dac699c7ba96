/* Which part of an ensemble a process does, and the names of its files. */
#include "lg-simulate/ensemble.h"

#include <stdlib.h>
#include <string.h>

int task_read(const app *self, const char *text, ensemble_task *out) {
    *out = self->rank_count > 1 ? (ensemble_task){self->rank, self->rank_count} : (ensemble_task){0, 0};
    if (text == NULL) return APP_EXIT_OK;
    if (out->count > 0)
        return app_usage(self, "--task is not for ranks of mpirun, which are tasks themselves");
    char *copy = app_format("%s", text), *slash = strchr(copy, '/');
    if (slash != NULL) *slash = '\0';
    const bool read =
        slash != NULL && app_parse_size(copy, &out->index) && app_parse_size(slash + 1, &out->count);
    free(copy);
    if (read && out->index < out->count && out->count <= TASKS_MAX) return APP_EXIT_OK;
    return app_usage(self, "--task: expected i/n with 0 <= i < n <= %d, not '%s'", TASKS_MAX, text);
}

/* "a/out.h5", ".x" -> "a/out.x.h5" */
static char *insert(const char *path, const char *text) {
    const char *dot = strrchr(path, '.'), *slash = strrchr(path, '/');
    const bool ending = dot != NULL && (slash == NULL || dot > slash);
    const int stem = (int)(ending ? (size_t)(dot - path) : strlen(path));
    return app_format("%.*s%s%s", stem, path, text, path + stem);
}

char *part_path(const char *out, const ensemble_task *task) {
    if (task->count == 0) return app_format("%s", out);
    char *which =
        app_format(".part-%llu-of-%llu", (unsigned long long)task->index, (unsigned long long)task->count);
    char *path = insert(out, which);
    free(which);
    return path;
}

char *rows_path(const char *path) {
    return insert(path, ".trajectories");
}

uint64_t rows_among(uint64_t saved, uint64_t first, uint64_t members) {
    const uint64_t end = saved < first + members ? saved : first + members;
    return end > first ? end - first : 0;
}

int ensemble_outputs(const app *self, const simulate_values *values, ensemble_output out[OUTPUTS]) {
    ensemble_task task;
    for (size_t i = 0; i < OUTPUTS; i++) out[i] = (ensemble_output){"out", NULL};
    const int code = task_read(self, values->task, &task);
    if (code != APP_EXIT_OK || values->out == NULL) return code;
    out[0].path = part_path(values->out, &task);
    if (values->save != NULL) out[1] = (ensemble_output){"save", rows_path(out[0].path)};
    /* Ranks make one file of theirs. */
    if (self->rank_count > 1) out[2].path = app_format("%s", values->out);
    return APP_EXIT_OK;
}
