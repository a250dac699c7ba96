/* Chooses the part of an ensemble that a process runs, and the names of its files. */
#include "common/trials.h"
#include "lg-simulate/ensemble.h"

#include <string.h>

/* insert("a/out.h5", ".x") returns "a/out.x.h5". */
static char *insert(const char *path, const char *text) {
    const char *dot = strrchr(path, '.'), *slash = strrchr(path, '/');
    const bool ending = dot != NULL && (slash == NULL || dot > slash);
    const size_t stem = ending ? (size_t)(dot - path) : strlen(path), size = strlen(path) + strlen(text) + 1;
    char *out = app_keep(size, 1);
    (void)snprintf(out, size, "%.*s%s%s", (int)stem, path, text, path + stem);
    return out;
}

char *part_path(const char *out, const ensemble_task *task) {
    char which[64] = "";
    if (task->count > 0)
        (void)snprintf(which, sizeof which, ".part-%llu-of-%llu", (unsigned long long)task->index,
                       (unsigned long long)task->count);
    return insert(out, which);
}

char *rows_path(const char *path) {
    return insert(path, ".trajectories");
}

uint64_t rows_among(uint64_t saved, uint64_t first, uint64_t members) {
    const uint64_t end = saved < first + members ? saved : first + members;
    return end > first ? end - first : 0;
}

void ensemble_files_choose(const app *self, const simulate_values *values, ensemble_files *out) {
    /* Rank r of R ranks is task r of R. */
    if (values->ensemble > 0 && self->rank_count > 1)
        out->task = (ensemble_task){self->rank, self->rank_count};
    if (values->ensemble > 0 && values->task != NULL)
        trials_task(self, values->task, TASKS_MAX, &out->task.index, &out->task.count);
    if (values->out == NULL) return;
    out->out = part_path(values->out, &out->task);
    if (values->save > 0) out->trajectories = rows_path(out->out);
}
