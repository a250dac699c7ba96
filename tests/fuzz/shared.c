/* Harnesses of what processes leave for each other: boards, and parts of an ensemble. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/board.h"
#include "fuzz.h"
#include "lg-simulate/ensemble.h"
#include "tree.h"

static void refused(lg_status status, const lg_error *error) {
    if (status != LG_OK && error->message[0] == '\0') abort();
}

/* ---- boards ---- */

/* Two tasks of one process: its locks do not exclude each other, so both may claim a piece. */
static void work_on(board *b, size_t count) {
    enum { RECORD = 24 };
    unsigned char record[RECORD] = {0};
    lg_error error = {LG_OK, ""};
    size_t piece, done = 0;
    for (size_t i = 0; i < count; i++) done += board_read(b, i, record) == BOARD_DONE;
    if (board_left(b) != count - done) abort();
    while (board_claim(b, &piece)) {
        const board_state state = board_read(b, piece, record);
        if (piece >= count || state == BOARD_DONE) abort();
        refused(board_write(b, piece, record, state == BOARD_EMPTY ? BOARD_PARTIAL : BOARD_DONE, &error),
                &error);
        if (state == BOARD_EMPTY) board_release(b, piece);
    }
    if (board_left(b) != 0) abort();
}

void fuzz_board(const uint8_t *data, size_t size) {
    enum { RECORD = 24, COUNT = 3 };
    static const board_values values = {.task = "0/2"};
    static const app by = {.title = "fuzz", .rank_count = 1};
    lg_error error = {LG_OK, ""};
    const char *path = fuzz_file(data, size);
    char out[256];
    (void)snprintf(out, sizeof out, "%.*s", (int)(strlen(path) - strlen(FUZZ_ENDING)), path);
    board *b = NULL;
    bool fresh = false;
    const lg_status status = board_open(&by, &values, out, "fuzz", RECORD, COUNT, &b, &fresh, &error);
    refused(status, &error);
    if (status != LG_OK) return;
    refused(board_begin(b, &error), &error);
    work_on(b, COUNT);
    board_close(b);
}

/* ---- parts ---- */

/* The counts summed over both parts must be counts that a file may have. */
static void merge(result *into, result *from) {
    lg_error error = {LG_OK, ""};
    from->first += from->members;
    for (size_t i = 0; i < from->listed; i++) from->failures[i].member += from->members;
    const lg_status status = result_merge(into, from, &error);
    refused(status, &error);
    if (status == LG_OK && result_failed(into) > into->members) abort();
}

void fuzz_parts(const uint8_t *data, size_t size) {
    static const app by = {.title = "fuzz", .rank_count = 1};
    const char *path = tree_file(data, size);
    char run[256];
    lg_error error = {LG_OK, ""};
    lg_rows_about about;
    lg_status status = lg_rows_file_look(NULL, path, &about, run, sizeof run, &error);
    refused(status, &error);
    if (status == LG_OK) return;
    result parts[2] = {{.what = NULL}, {.what = NULL}};
    for (int i = 0; i < 2; i++) {
        status = result_read(&by, path, &parts[i], &error);
        refused(status, &error);
        if (status != LG_OK) break;
    }
    if (status == LG_OK) merge(&parts[0], &parts[1]);
    for (int i = 0; i < 2; i++) result_free(&parts[i]);
}
