/* Harnesses of what processes leave for each other: parts of work and of an ensemble. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/trials.h"
#include "fuzz.h"
#include "lg-simulate/ensemble.h"
#include "tree.h"

/* ---- parts of work ---- */

enum { PART_RECORD = 24, PART_COUNT = 3 };

static bool take_record(void *user, size_t item, void *record, bool done, bool own) {
    (void)user, (void)done, (void)own;
    if (item >= PART_COUNT) abort();
    return *(const unsigned char *)record != 0;
}

/* A task reads the part that it has left, adds the items that are missing, and finds all of them in it. */
void fuzz_part(const uint8_t *data, size_t size) {
    static const trials_values values = {.task = "0/2"};
    static app by = {.title = "fuzz", .rank_count = 1};
    const unsigned char record[PART_RECORD] = {1};
    const char *path = fuzz_file(data, size);
    char out[256];
    (void)snprintf(out, sizeof out, "%.*s", (int)(strlen(path) - strlen(FUZZ_ENDING)), path);
    for (int time = 0; time < 2; time++) {
        trials_work t = {.app = &by,
                         .values = &values,
                         .out = out,
                         .count = PART_COUNT,
                         .record = PART_RECORD,
                         .take = take_record};
        lg_error error = {LG_OK, ""};
        (void)trials_choose(&t, NULL);
        const lg_status status = trials_open(&t, "fuzz", &error);
        fuzz_status(status, &error);
        if (time == 1 && (status != LG_OK || trials_known(&t) != PART_COUNT)) abort();
        for (size_t i = 0; i < PART_COUNT && status == LG_OK; i++) {
            trials_exchange(&t, i, record);
            if (!t.known[i] && trials_add(&t, i, record, true, &error) != LG_OK) abort();
        }
        trials_close(&t);
        if (status != LG_OK) return;
    }
}

/* ---- parts of an ensemble ---- */

/* The counts summed over both parts must be counts that a file may have. */
static void merge(result *into, result *from) {
    lg_error error = {LG_OK, ""};
    from->first += from->members;
    for (size_t i = 0; i < from->listed; i++) from->who[i][0] += from->members;
    const lg_status status = result_merge(into, from, &error);
    fuzz_status(status, &error);
    if (status == LG_OK && result_failed(into) > into->members) abort();
}

void fuzz_parts(const uint8_t *data, size_t size) {
    static const app by = {.title = "fuzz", .rank_count = 1};
    const char *path = tree_file(data, size);
    char run[256];
    lg_error error = {LG_OK, ""};
    lg_rows_about about;
    lg_status status = lg_rows_file_look(NULL, path, &about, run, sizeof run, &error);
    fuzz_status(status, &error);
    if (status == LG_OK) return;
    result parts[2] = {{.what = NULL}, {.what = NULL}};
    for (int i = 0; i < 2; i++) {
        status = result_read(&by, path, &parts[i], &error);
        fuzz_status(status, &error);
        if (status != LG_OK) break;
    }
    if (status == LG_OK) merge(&parts[0], &parts[1]);
    for (int i = 0; i < 2; i++) result_free(&parts[i]);
}
