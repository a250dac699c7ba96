/* A board of work: a file with the results, and locks on bytes far beyond its end. */
#include "common/board.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

/* The file: this head, then `count` slots, each with a state (8 bytes) and a record. */
typedef struct head {
    char magic[16], sweep[128];
    /* ready: results known before are written, and other processes may begin */
    uint64_t record, count, ready;
} head;
static const char magic[16] = "liegrad board 1";

/* The locked bytes are LOCKS + LOCK_BOARD and so on; piece i has the byte LOCKS + LOCK_PIECES + i. */
#define LOCKS ((off_t)1 << 40)
enum { LOCK_BOARD, LOCK_RECORDS, LOCK_PIECES };

struct board {
    char *path;
    int fd;
    size_t record, count;
    bool wait;
    pthread_mutex_t mutex;
    /* Both (count): the pieces that this process knows to be done, and the pieces it has claimed. */
    bool *done, *mine;
};

/* ---- locks ---- */

/* Waits for the lock unless `try`. False: another process has the lock, or the file system has no locks. */
static bool lock(const board *b, off_t byte, short type, bool try) {
    struct flock range = {.l_type = type, .l_whence = SEEK_SET, .l_start = LOCKS + byte, .l_len = 1};
    int code;
    do code = fcntl(b->fd, try ? F_SETLK : F_SETLKW, &range);
    while (code != 0 && errno == EINTR);
    return code == 0;
}

static void unlock(const board *b, off_t byte) {
    (void)lock(b, byte, F_UNLCK, true);
}

static void nap(long milliseconds) {
    const struct timespec pause = {.tv_sec = 0, .tv_nsec = milliseconds * 1000000};
    (void)nanosleep(&pause, NULL);
}

/* ---- reading and writing ---- */

static lg_status put(const board *b, const void *data, size_t bytes, off_t at, lg_error *error) {
    for (const char *from = data; bytes > 0;) {
        const ssize_t n = pwrite(b->fd, from, bytes, at);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0)
            return app_error(error, LG_FILE, "%s: cannot be written: %s", b->path,
                             strerror(n < 0 ? errno : ENOSPC));
        from += n, at += n, bytes -= (size_t)n;
    }
    return LG_OK;
}

static bool get(const board *b, void *data, size_t bytes, off_t at) {
    for (char *to = data; bytes > 0;) {
        const ssize_t n = pread(b->fd, to, bytes, at);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        to += n, at += n, bytes -= (size_t)n;
    }
    return true;
}

static off_t slot(const board *b, size_t piece) {
    return (off_t)(sizeof(head) + piece * (sizeof(uint64_t) + b->record));
}

/* A piece whose record is cut off has no state. */
static board_state state_of(const board *b, size_t piece) {
    const off_t at = slot(b, piece);
    uint64_t state;
    char last;
    const bool whole = get(b, &state, sizeof state, at) &&
                       get(b, &last, sizeof last, at + (off_t)(sizeof state + b->record - sizeof last));
    return whole && state <= BOARD_DONE ? (board_state)state : BOARD_EMPTY;
}

/* ---- opening ---- */

bool board_wanted(app *self, const board_values *values, const char *out) {
    uint64_t i = 0, n = 1;
    if (values->task != NULL) {
        const char *slash = strchr(values->task, '/');
        APP_FREE char *first =
            app_format("%.*s", slash != NULL ? (int)(slash - values->task) : 0, values->task);
        if (slash == NULL || !app_parse_size(first, &i) || !app_parse_size(slash + 1, &n) || i >= n)
            app_stop_usage(self, "--task: expected i/n with i from 0 to n - 1, as in 3/16");
        if (values->merge)
            app_stop_usage(
                self,
                "--task does a part of the work and --merge only collects the results; give one of them");
    }
    APP_FREE char *path = app_format("%s.board", out);
    self->shares = self->rank_count > 1 || values->task != NULL || values->merge || access(path, F_OK) == 0;
    return self->shares;
}

/* Returns whether the output was written since this process began (give or take `slack` seconds): then rank 0
 * had finished before this rank saw the board. */
static bool is_over(const char *out) {
    static const double slack = 2.0;
    struct stat about;
    struct timespec now;
    (void)clock_gettime(CLOCK_REALTIME, &now);
    return stat(out, &about) == 0 && difftime(now.tv_sec, about.st_mtime) <= app_age() + slack;
}

void board_label(const char *text, const char *path, char label[LG_SHA256_TEXT]) {
    lg_sha256 sha;
    char block[4096];
    size_t n;
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, text, strlen(text) + 1);
    FILE *file = path != NULL ? app_open(path) : NULL;
    while (file != NULL && (n = fread(block, 1, sizeof block, file)) > 0) lg_sha256_add(&sha, block, n);
    if (file != NULL) (void)fclose(file);
    lg_sha256_finish(&sha, label);
}

static lg_status open_file(board *b, bool make, lg_error *error) {
    enum { PATIENCE = 10000, PAUSE = 20 }; /* milliseconds */
    for (int waited = 0;; waited += PAUSE) {
        struct stat about;
        b->fd = open(b->path, make ? O_RDWR | O_CREAT | O_CLOEXEC : O_RDWR | O_CLOEXEC, 0666);
        if (b->fd < 0 && (make || errno != ENOENT || waited >= PATIENCE))
            return app_error(error, errno == ENOENT ? LG_NOT_FOUND : LG_FILE, "%s: cannot be opened: %s",
                             b->path, strerror(errno));
        if (b->fd >= 0) {
            if (!lock(b, LOCK_BOARD, F_WRLCK, false))
                return app_error(error, LG_FILE, "%s: cannot be locked: %s", b->path, strerror(errno));
            if (fstat(b->fd, &about) == 0 && about.st_nlink > 0) return LG_OK;
            (void)close(b->fd); /* the board was removed before this process got the lock */
            b->fd = -1;
        }
        nap(PAUSE);
    }
}

static lg_status check_head(const board *b, const head *mine, bool *fresh, lg_error *error) {
    head found = {.ready = 0};
    struct stat about;
    if (fstat(b->fd, &about) == 0 && about.st_size == 0) {
        *fresh = true;
        return put(b, mine, sizeof *mine, 0, error);
    }
    const bool whole = get(b, &found, sizeof found, 0);
    *fresh = whole && found.ready == 0;
    if (whole && memcmp(found.magic, mine->magic, sizeof found.magic) == 0 && found.record == mine->record &&
        found.count == mine->count && memcmp(found.sweep, mine->sweep, sizeof found.sweep) == 0)
        return LG_OK;
    return app_error(error, LG_FORMAT,
                     "%s: belongs to work with other options or data; remove it, or write to another file",
                     b->path);
}

lg_status board_open(const app *self, const board_values *values, const char *out, const char *sweep,
                     size_t record, size_t count, board **board_out, bool *fresh, lg_error *error) {
    board *b = app_alloc(1, sizeof *b);
    head mine = {.record = record, .count = count};
    memcpy(mine.magic, magic, sizeof magic);
    (void)snprintf(mine.sweep, sizeof mine.sweep, "%s", sweep);
    *b = (board){.path = app_format("%s.board", out),
                 .fd = -1,
                 .record = record,
                 .count = count,
                 .wait = values->task == NULL,
                 .done = app_alloc(count, sizeof *b->done),
                 .mine = app_alloc(count, sizeof *b->mine)};
    (void)pthread_mutex_init(&b->mutex, NULL);
    lg_status status = open_file(b, self->rank == 0, error);
    if (status == LG_NOT_FOUND && !is_over(out))
        status = app_error(error, LG_FILE, "%s: is missing: rank 0 has not created it", b->path);
    if (status == LG_OK) status = check_head(b, &mine, fresh, error);
    if (status == LG_OK)
        *board_out = b;
    else
        board_close(b);
    return status;
}

lg_status board_begin(board *b, lg_error *error) {
    const uint64_t ready = 1;
    const lg_status status = put(b, &ready, sizeof ready, offsetof(head, ready), error);
    unlock(b, LOCK_BOARD);
    return status;
}

void board_close(board *b) {
    if (b == NULL) return;
    if (b->fd >= 0) (void)close(b->fd); /* this also releases all locks */
    (void)pthread_mutex_destroy(&b->mutex);
    free(b->path);
    free(b->done);
    free(b->mine);
    free(b);
}

const char *board_path(const board *b) {
    return b->path;
}

/* ---- pieces ---- */

/* fcntl locks belong to the process, so its threads exclude each other by a mutex. */
bool board_claim(board *b, size_t *piece) {
    bool found = false;
    (void)pthread_mutex_lock(&b->mutex);
    for (size_t i = 0; i < b->count && !found; i++) {
        if (b->done[i] || b->mine[i] || !lock(b, LOCK_PIECES + (off_t)i, F_WRLCK, true)) continue;
        b->done[i] = state_of(b, i) == BOARD_DONE;
        if (b->done[i]) {
            unlock(b, LOCK_PIECES + (off_t)i);
            continue;
        }
        b->mine[i] = found = true;
        *piece = i;
    }
    (void)pthread_mutex_unlock(&b->mutex);
    return found;
}

bool board_next(board *b, size_t *piece) {
    enum { PAUSE = 50 };
    while (!app_interrupted()) {
        if (board_claim(b, piece)) return true;
        if (!b->wait || board_left(b) == 0) return false;
        nap(PAUSE);
    }
    return false;
}

void board_release(board *b, size_t piece) {
    (void)pthread_mutex_lock(&b->mutex);
    b->mine[piece] = false;
    unlock(b, LOCK_PIECES + (off_t)piece);
    (void)pthread_mutex_unlock(&b->mutex);
}

board_state board_read(board *b, size_t piece, void *record) {
    (void)pthread_mutex_lock(&b->mutex);
    (void)lock(b, LOCK_RECORDS, F_RDLCK, false);
    board_state state = state_of(b, piece);
    if (state != BOARD_EMPTY && !get(b, record, b->record, slot(b, piece) + (off_t)sizeof(uint64_t)))
        state = BOARD_EMPTY;
    unlock(b, LOCK_RECORDS);
    (void)pthread_mutex_unlock(&b->mutex);
    return state;
}

/* The record is written before the state, so that a piece counts as done only when its result is complete. */
lg_status board_write(board *b, size_t piece, const void *record, board_state state, lg_error *error) {
    const uint64_t word = state;
    (void)pthread_mutex_lock(&b->mutex);
    (void)lock(b, LOCK_RECORDS, F_WRLCK, false);
    lg_status status = put(b, record, b->record, slot(b, piece) + (off_t)sizeof word, error);
    if (status == LG_OK && state == BOARD_DONE && fdatasync(b->fd) != 0)
        status = app_error(error, LG_FILE, "%s: cannot be written: %s", b->path, strerror(errno));
    if (status == LG_OK) status = put(b, &word, sizeof word, slot(b, piece), error);
    unlock(b, LOCK_RECORDS);
    if (status == LG_OK && state == BOARD_DONE) b->done[piece] = true;
    (void)pthread_mutex_unlock(&b->mutex);
    if (status == LG_OK && state == BOARD_DONE) board_release(b, piece);
    return status;
}

size_t board_left(board *b) {
    size_t left = 0;
    (void)pthread_mutex_lock(&b->mutex);
    for (size_t i = 0; i < b->count; i++) {
        if (!b->done[i]) b->done[i] = state_of(b, i) == BOARD_DONE;
        left += !b->done[i];
    }
    (void)pthread_mutex_unlock(&b->mutex);
    return left;
}

lg_status board_unfinished(const board *b, size_t left, lg_error *error) {
    return app_error(error, LG_FILE, "%s: %zu of %zu pieces are not done yet", b->path, left, b->count);
}

int board_report(const app *self, const board_values *values, size_t done, size_t count) {
    app_json out;
    app_result_begin(&out, self);
    app_result_line(&out, "task %s: all tasks together have done %zu of %zu pieces%s", values->task, done,
                    count, done == count ? "; collect them with --merge" : "");
    app_json_text(&out, "task", values->task);
    app_json_size(&out, "done", done);
    app_json_size(&out, "count", count);
    app_json_end(&out);
    return APP_EXIT_OK;
}

/* ---- writing the output ---- */

bool board_lock(board *b) {
    struct stat about;
    if (!lock(b, LOCK_BOARD, F_WRLCK, false)) return false;
    if (fstat(b->fd, &about) == 0 && about.st_nlink > 0) return true;
    unlock(b, LOCK_BOARD);
    return false;
}

void board_wait_for_end(const board *b) {
    enum { PATIENCE = 3000, PAUSE = 50 };
    struct stat about;
    for (int waited = 0; waited < PATIENCE; waited += PAUSE) {
        if (fstat(b->fd, &about) != 0 || about.st_nlink == 0) return;
        nap(PAUSE);
    }
}

void board_end(board *b, bool kept) {
    if (!kept) (void)unlink(b->path);
    unlock(b, LOCK_BOARD);
}
