/* A board of work: a file with the results, and locks on bytes far beyond its end. */
#include "common/board.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

/* The file: this head, then `count` slots, each with a state (8 bytes), a beat (8 bytes) and a record. A
 * process that has the lock of a piece, or of the board, raises the beat of the piece, or of the head, every
 * second. So other processes see that this process lives. Behind the slots of the pieces, each rank of mpirun
 * has a slot, its seat. The beat of a seat shows that the rank has come and lives; the lock of a seat shows
 * that the rank has not left. */
typedef struct head {
    char magic[16], sweep[128];
    /* ready: results known before are written, and other processes may begin */
    uint64_t record, count, ready, beat;
} head;
static const char magic[16] = "liegrad board 2";
#define SLOT_HEAD ((off_t)(2 * sizeof(uint64_t)))

/* The locked bytes are LOCKS + LOCK_BOARD and so on; piece i has the byte LOCKS + LOCK_PIECES + i. */
#define LOCKS ((off_t)1 << 40)
enum { LOCK_BOARD, LOCK_RECORDS, LOCK_PIECES };

/* The last beat that was seen of a lock's holder, and the seconds since then. */
typedef struct sign {
    uint64_t beat;
    double silent;
    bool seen; /* the beat has changed since the board was opened: the rank has come */
} sign;

enum { LOOK_PAUSE = 50 }; /* milliseconds between two looks at the beats */

struct board {
    const app *app;
    char *path;
    int fd;
    size_t record, count;
    board_check *is_record;
    const void *user; /* of is_record */
    void *spare;      /* (record) */
    bool wait;
    pthread_mutex_t mutex;
    size_t seats; /* number of ranks of mpirun; 0 without mpirun */
    /* Both arrays have count + seats elements. done: pieces that are done, and ranks for which this process
     * need not wait. mine: the pieces that this process has claimed, and its seat. */
    bool *done, *mine;
    double silence, looked; /* limit of sign.silent; time at which take_over last looked at the beats */
    sign *signs;            /* (count + seats) */
    pthread_t heart;        /* the thread that raises the beats */
    pthread_cond_t ending;
    bool beats;    /* the thread runs */
    bool holds;    /* this process holds the lock LOCK_BOARD */
    bool over;     /* the thread has to end */
    bool begun;    /* board_begin has returned LG_OK */
    bool unlocked; /* a process that is stopped has the lock of the records */
};

/* ---- locks ---- */

/* False: another process has the lock, or the file system has no locks. */
static bool try_lock(const board *b, off_t byte, short type) {
    struct flock range = {.l_type = type, .l_whence = SEEK_SET, .l_start = LOCKS + byte, .l_len = 1};
    int code;
    do code = fcntl(b->fd, F_SETLK, &range);
    while (code != 0 && errno == EINTR);
    return code == 0;
}

static void unlock(const board *b, off_t byte) {
    (void)try_lock(b, byte, F_UNLCK);
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
    return (off_t)sizeof(head) + (off_t)piece * (SLOT_HEAD + (off_t)b->record);
}

static off_t beat_of(const board *b, size_t piece) {
    return slot(b, piece) + (off_t)sizeof(uint64_t);
}

/* Reads a record; for `spare` it reads only as much as is needed. A piece whose record is incomplete or
 * impossible counts as not done and is computed again. */
static board_state state_of(const board *b, size_t piece, void *record) {
    const off_t at = slot(b, piece);
    const bool all = record != b->spare || b->is_record != NULL;
    const size_t before = all ? 0 : b->record - 1;
    uint64_t state;
    if (!get(b, &state, sizeof state, at) ||
        !get(b, record, b->record - before, at + SLOT_HEAD + (off_t)before) || state > BOARD_DONE)
        return BOARD_EMPTY;
    const bool sound = state == BOARD_EMPTY || b->is_record == NULL || b->is_record(b->user, piece, record);
    return sound ? (board_state)state : BOARD_EMPTY;
}

/* ---- signs of life ---- */

/* Whether the process that raises the beat at `at` is stopped or not reached. `passed`: seconds since the
 * last look, but at most about the pause between two looks. So the time in which this process was stopped
 * does not count as silence of the other process. */
static bool is_silent(const board *b, off_t at, double passed, sign *s) {
    uint64_t beat = 0;
    (void)get(b, &beat, sizeof beat, at);
    s->seen = s->seen || beat != s->beat;
    s->silent = beat == s->beat ? s->silent + passed : 0.0;
    s->beat = beat;
    return s->silent > b->silence;
}

/* Waits for the lock. False: the file system has no locks, or (errno is ETIMEDOUT) the process that has the
 * lock does not raise the beat at `at`. Then `s` gets the last beat of that process, and how long that
 * process has been silent. */
static bool lock(const board *b, off_t byte, short type, off_t at, sign *s) {
    enum { LONGEST = 50 };
    double before = app_seconds();
    for (long pause = 1; !try_lock(b, byte, type); pause = pause < LONGEST ? 2 * pause : LONGEST) {
        if (errno != EACCES && errno != EAGAIN) return false;
        nap(pause);
        const double now = app_seconds();
        errno = ETIMEDOUT;
        if (is_silent(b, at, fmin(now - before, 2e-3 * LONGEST), s)) return false;
        before = now;
    }
    return true;
}

/* Why `lock` has returned false. */
static const char *lock_error(void) {
    return errno == ETIMEDOUT ? "another process has it, and gives no sign of life (LIEGRAD_SILENCE)"
                              : strerror(errno);
}

static void raise_beat(const board *b, off_t at) {
    uint64_t beat = 0;
    (void)get(b, &beat, sizeof beat, at);
    beat++;
    (void)put(b, &beat, sizeof beat, at, NULL);
}

static void *heart(void *user) {
    board *b = user;
    struct timespec until;
    (void)pthread_mutex_lock(&b->mutex);
    for (;;) {
        (void)clock_gettime(CLOCK_MONOTONIC, &until);
        until.tv_sec++;
        (void)pthread_cond_timedwait(&b->ending, &b->mutex, &until);
        if (b->over) break;
        if (b->holds) raise_beat(b, (off_t)offsetof(head, beat));
        for (size_t i = 0; i < b->count + b->seats; i++)
            if (b->mine[i]) raise_beat(b, beat_of(b, i));
    }
    (void)pthread_mutex_unlock(&b->mutex);
    return NULL;
}

/* The heart waits by the monotonic clock: it must beat every second when the wall clock is set back, too. */
static void make_ending(board *b) {
    pthread_condattr_t how;
    (void)pthread_condattr_init(&how);
    (void)pthread_condattr_setclock(&how, CLOCK_MONOTONIC);
    (void)pthread_cond_init(&b->ending, &how);
    (void)pthread_condattr_destroy(&how);
}

static void stop_heart(board *b) {
    (void)pthread_mutex_lock(&b->mutex);
    b->over = true;
    (void)pthread_cond_signal(&b->ending);
    (void)pthread_mutex_unlock(&b->mutex);
    if (b->beats) (void)pthread_join(b->heart, NULL);
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

lg_status board_label(const char *text, const char *path, char label[LG_SHA256_TEXT], lg_error *error) {
    lg_sha256 sha;
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, text, strlen(text) + 1);
    if (path != NULL) LG_TRY(app_hash_file(path, &sha, error));
    lg_sha256_finish(&sha, label);
    return LG_OK;
}

/* Called when the file has been opened. */
static lg_status take_seat(board *b, lg_error *error) {
    for (size_t i = 0; i < b->seats; i++)
        (void)get(b, &b->signs[b->count + i].beat, sizeof(uint64_t), beat_of(b, b->count + i));
    if (b->seats > 0) {
        const size_t seat = b->count + b->app->rank;
        (void)try_lock(b, LOCK_PIECES + (off_t)seat, F_WRLCK);
        raise_beat(b, beat_of(b, seat));
        b->mine[seat] = b->done[seat] = true;
    }
    if (!b->beats) b->beats = pthread_create(&b->heart, NULL, heart, b) == 0;
    return b->beats ? LG_OK : app_error(error, LG_OUT_OF_MEMORY, "no memory for a thread");
}

/* Waits until each other rank has come, or is silent. With `left` it waits until each other rank has left, or
 * is silent. */
static void wait_for_ranks(board *b, bool left) {
    bool waits = true;
    for (double before = app_seconds(), now; waits && !app_interrupted(); before = now) {
        nap(LOOK_PAUSE);
        now = app_seconds();
        waits = false;
        (void)pthread_mutex_lock(&b->mutex);
        for (size_t i = b->count; i < b->count + b->seats; i++) {
            if (b->done[i]) continue;
            sign *s = &b->signs[i];
            const bool silent = is_silent(b, beat_of(b, i), fmin(now - before, 2e-3 * LOOK_PAUSE), s);
            if (silent) app_leave_behind(b->app, "rank", i - b->count);
            const bool there = !left || try_lock(b, LOCK_PIECES + (off_t)i, F_WRLCK);
            if (left && there) unlock(b, LOCK_PIECES + (off_t)i);
            b->done[i] = silent || (left && s->seen && there);
            waits = waits || !(b->done[i] || (!left && s->seen));
        }
        (void)pthread_mutex_unlock(&b->mutex);
    }
}

static bool is_ready(const board *b) {
    head found = {.ready = 0};
    return get(b, &found, sizeof found, 0) && found.ready != 0;
}

/* Opens the file; with `make`, creates it if it does not exist. A board begins with the magic. A file without
 * it stays unchanged. LG_NOT_FOUND: the file does not exist, or rank 0 is about to create it. */
static lg_status open_board(board *b, bool make, lg_error *error) {
    char found[sizeof magic] = "";
    b->fd = make ? open(b->path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666) : -1;
    const bool made = b->fd >= 0;
    if (!made) b->fd = open(b->path, O_RDWR | O_CLOEXEC);
    if (b->fd < 0)
        return app_error(error, errno == ENOENT ? LG_NOT_FOUND : LG_FILE, "%s: cannot be opened: %s", b->path,
                         strerror(errno));
    lg_status status = made ? put(b, magic, sizeof magic, 0, error) : LG_OK;
    if (status == LG_OK && !get(b, found, 1, 0))
        status = app_error(error, LG_NOT_FOUND, "%s: is empty: remove it", b->path);
    if (status == LG_OK && (!get(b, found, sizeof found, 0) || memcmp(found, magic, sizeof magic) != 0))
        status = app_error(error, LG_FILE,
                           "%s: exists and is not a board: remove it, or write to another file", b->path);
    if (status != LG_OK) (void)close(b->fd), b->fd = -1;
    return status;
}

/* Opens the board and takes its lock. Rank 0 creates the board, and the other ranks wait for it. Otherwise
 * these ranks could finish all work and remove the board while rank 0 waits for the lock. *removed becomes
 * true if the other ranks finished all work, and removed the board, before this rank got the lock. */
static lg_status open_file(board *b, bool make, bool *removed, lg_error *error) {
    enum { PAUSE = 20 };             /* milliseconds */
    static const double longest = 2; /* seconds from the making of a board to its first bytes */
    for (double waited = 0.0;; waited += 1e-3 * PAUSE) {
        struct stat about;
        const lg_status status = open_board(b, make, error);
        if (status == LG_FILE || (status != LG_OK && (*removed || waited >= (make ? longest : b->silence))))
            return status;
        if (status == LG_OK) {
            LG_TRY(take_seat(b, error));
            if (!lock(b, LOCK_BOARD, F_WRLCK, (off_t)offsetof(head, beat), &(sign){0, 0.0, false}))
                return app_error(error, LG_FILE, "%s: cannot be locked: %s", b->path, lock_error());
            *removed = fstat(b->fd, &about) == 0 && about.st_nlink == 0;
            if (!*removed && (make || is_ready(b))) return LG_OK;
            (void)pthread_mutex_lock(&b->mutex);
            if (*removed && b->seats > 0)
                raise_beat(b, beat_of(b, b->count + b->app->rank)); /* as in leave_seat */
            (void)close(b->fd);                                     /* and releases the locks */
            b->fd = -1;
            (void)pthread_mutex_unlock(&b->mutex);
        }
        nap(PAUSE);
    }
}

/* A board whose head has no count is new: it has only the magic and possibly seats. */
static lg_status check_head(const board *b, const head *mine, bool *fresh, lg_error *error) {
    head found = {.ready = 0};
    const bool whole = get(b, &found, sizeof found, 0) && found.count > 0;
    *fresh = !whole || found.ready == 0;
    if (!whole) return put(b, mine, sizeof *mine, 0, error);
    if (found.record == mine->record && found.count == mine->count &&
        memcmp(found.sweep, mine->sweep, sizeof found.sweep) == 0)
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
    const double silence = app_silence(self);
    const size_t seats = self->rank_count > 1 ? self->rank_count : 0;
    *b = (board){.app = self,
                 .path = app_format("%s.board", out),
                 .fd = -1,
                 .record = record,
                 .count = count,
                 .spare = app_alloc(record, 1),
                 .wait = values->task == NULL,
                 .seats = seats,
                 .done = app_alloc(count + seats, sizeof *b->done),
                 .mine = app_alloc(count + seats, sizeof *b->mine),
                 .silence = silence > 0.0 ? silence : INFINITY,
                 .signs = app_alloc(count + seats, sizeof *b->signs)};
    (void)pthread_mutex_init(&b->mutex, NULL);
    make_ending(b);
    bool removed = false;
    lg_status status = open_file(b, self->rank == 0, &removed, error);
    if (status == LG_NOT_FOUND && !removed && !is_over(out))
        status = app_error(error, LG_FILE, "%s: is missing: rank 0 has not created it", b->path);
    if (status == LG_OK) status = check_head(b, &mine, fresh, error);
    b->holds = status == LG_OK;
    if (status == LG_OK)
        *board_out = b;
    else
        board_close(b);
    return status;
}

void board_set_check(board *b, board_check *is_record, const void *user) {
    b->is_record = is_record;
    b->user = user;
}

static void let_go(board *b) {
    (void)pthread_mutex_lock(&b->mutex);
    b->holds = false;
    unlock(b, LOCK_BOARD);
    (void)pthread_mutex_unlock(&b->mutex);
}

lg_status board_begin(board *b, lg_error *error) {
    const uint64_t ready = 1;
    const lg_status status = put(b, &ready, sizeof ready, offsetof(head, ready), error);
    let_go(b);
    b->begun = status == LG_OK;
    return status;
}

/* A rank leaves when all other ranks are leaving or silent. Its last beat shows late ranks that it had
 * come. */
static void leave_seat(board *b) {
    const size_t seat = b->count + b->app->rank;
    (void)pthread_mutex_lock(&b->mutex);
    unlock(b, LOCK_PIECES + (off_t)seat);
    (void)pthread_mutex_unlock(&b->mutex);
    wait_for_ranks(b, true);
    (void)pthread_mutex_lock(&b->mutex);
    raise_beat(b, beat_of(b, seat));
    (void)pthread_mutex_unlock(&b->mutex);
}

void board_close(board *b) {
    if (b == NULL) return;
    if (b->begun && b->seats > 0) leave_seat(b);
    stop_heart(b);
    if (b->fd >= 0) (void)close(b->fd); /* this also releases all locks */
    (void)pthread_cond_destroy(&b->ending);
    (void)pthread_mutex_destroy(&b->mutex);
    free(b->path);
    free(b->spare);
    free(b->signs);
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
        if (b->done[i] || b->mine[i] || !try_lock(b, LOCK_PIECES + (off_t)i, F_WRLCK)) continue;
        b->done[i] = state_of(b, i, b->spare) == BOARD_DONE;
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

/* If the process that has the lock of a piece is silent, claims the piece without the lock. If the silent
 * process goes on later, both processes write the same result. */
static bool take_over(board *b, size_t *piece) {
    bool found = false;
    (void)pthread_mutex_lock(&b->mutex);
    const double now = app_seconds(), passed = fmin(now - b->looked, 2e-3 * LOOK_PAUSE);
    b->looked = now;
    for (size_t i = 0; i < b->count + b->seats && !found; i++) {
        if (b->done[i] || b->mine[i] || !is_silent(b, beat_of(b, i), passed, &b->signs[i])) continue;
        if (i >= b->count) continue; /* a rank, for wait_for_ranks */
        b->signs[i].silent = 0.0;
        b->mine[i] = found = true;
        *piece = i;
    }
    (void)pthread_mutex_unlock(&b->mutex);
    if (found) app_leave_behind(b->app, "piece", *piece);
    return found;
}

bool board_next(board *b, size_t *piece) {
    while (!app_interrupted()) {
        if (board_claim(b, piece)) return true;
        if (!b->wait || board_left(b) == 0) return false;
        if (take_over(b, piece)) return true;
        nap(LOOK_PAUSE);
    }
    return false;
}

void board_release(board *b, size_t piece) {
    (void)pthread_mutex_lock(&b->mutex);
    b->mine[piece] = false;
    unlock(b, LOCK_PIECES + (off_t)piece);
    (void)pthread_mutex_unlock(&b->mutex);
}

/* With this lock, network file systems show the latest records. A process holds it for milliseconds. If a
 * process is stopped while it holds the lock, the others go on without the lock. */
static void lock_records(board *b, short type) {
    static const double share = 0.1; /* share of the silence; this process raises no beats meanwhile */
    sign s = {0, b->silence * (1.0 - share), false};
    if (b->unlocked)
        (void)try_lock(b, LOCK_RECORDS, type);
    else
        b->unlocked = !lock(b, LOCK_RECORDS, type, LOCKS, &s) && errno == ETIMEDOUT;
}

board_state board_read(board *b, size_t piece, void *record) {
    (void)pthread_mutex_lock(&b->mutex);
    lock_records(b, F_RDLCK);
    const board_state state = state_of(b, piece, record);
    unlock(b, LOCK_RECORDS);
    (void)pthread_mutex_unlock(&b->mutex);
    return state;
}

/* The record is written before the state, so that a piece counts as done only when its result is complete. */
lg_status board_write(board *b, size_t piece, const void *record, board_state state, lg_error *error) {
    const uint64_t word = state;
    (void)pthread_mutex_lock(&b->mutex);
    lock_records(b, F_WRLCK);
    lg_status status = put(b, record, b->record, slot(b, piece) + SLOT_HEAD, error);
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
        if (!b->done[i]) b->done[i] = state_of(b, i, b->spare) == BOARD_DONE;
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

/* Waits for the end of the work, which rank 0 writes unless it is slow. */
static void wait_for_end(const board *b) {
    enum { PATIENCE = 3000, PAUSE = 50 };
    struct stat about;
    for (int waited = 0; waited < PATIENCE; waited += PAUSE) {
        if (fstat(b->fd, &about) != 0 || about.st_nlink == 0) return;
        nap(PAUSE);
    }
}

bool board_lock(board *b) {
    struct stat about;
    if (b->app->rank > 0) wait_for_end(b);
    if (!lock(b, LOCK_BOARD, F_WRLCK, (off_t)offsetof(head, beat), &(sign){0, 0.0, false}))
        app_stop(b->app, LG_FILE, "%s: cannot be locked: %s", b->path, lock_error());
    (void)pthread_mutex_lock(&b->mutex);
    b->holds = fstat(b->fd, &about) == 0 && about.st_nlink > 0;
    if (!b->holds) unlock(b, LOCK_BOARD);
    (void)pthread_mutex_unlock(&b->mutex);
    return b->holds;
}

void board_end(board *b, bool kept) {
    wait_for_ranks(b, false);
    if (!kept) (void)unlink(b->path);
    let_go(b);
}
