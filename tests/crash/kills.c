/* Kills commands (SIGKILL) at random moments, lets them continue, and compares the results with those of an
 * uninterrupted run:
 *
 *     kills FOLDER-OF-EXECUTABLES [-n KILLS] [-s SEED] [-o NAME]
 *
 * Half of the moments are uniform over the time of the uninterrupted run. The other half are up to 3 ms after
 * the beginning of a randomly drawn write. After a kill each output must be absent, unchanged, or complete,
 * and a checkpoint must be readable and hold at least what it held before the kill. Then the command runs
 * again, with --resume if there is a checkpoint; in a third of the cases it is killed again. At the end the
 * outputs must equal those of the uninterrupted run, the run must have written exactly the missing
 * checkpoints, and no temporary file or lock may be left, but for the folder of a killed lg-export. If a
 * check fails the exit code is 1. The results are printed as a Markdown table. */
#define _GNU_SOURCE /* getopt in addition to POSIX */
#include "crash/commands.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <sys/inotify.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { DRAWS = 40, PATIENCE = 120 };
static const double after_write = 3e-3; /* s */
typedef struct result {
    uint64_t kills, first, writing, later, resumed, equal, left, failed;
} result;

static lg_rng rng;

static void sleep_for(double seconds) {
    const struct timespec pause = {(time_t)seconds, (long)(1e9 * (seconds - (double)(time_t)seconds))};
    if (seconds > 0) (void)nanosleep(&pause, NULL);
}

/* ---- writes, observed in the folder by inotify ---- */

typedef struct listener {
    int fd;
    const job *job;
    long begun, saved; /* number of writes; number of checkpoints renamed */
} listener;

static listener listen_to(const job *j) {
    const listener made = {inotify_init1(IN_NONBLOCK | IN_CLOEXEC), j, 0, 0};
    if (inotify_add_watch(made.fd, work(""), IN_CREATE | IN_MOVED_TO | IN_MODIFY) < 0)
        stop("kills: inotify: %s", strerror(errno));
    return made;
}

static void count_event(listener *l, const struct inotify_event *event) {
    const char *name = event->len > 0 ? event->name : "", *checkpoint = l->job->checkpoint;
    const bool watched = checkpoint != NULL && strcmp(name, checkpoint) == 0;
    const bool log = l->job->appends && strcmp(name, l->job->outputs[0]) == 0;
    if ((event->mask & IN_CREATE) != 0 && strstr(name, ".liegrad-tmp-") != NULL) l->begun++;
    if ((event->mask & IN_MODIFY) != 0 && (watched || log)) l->begun++;
    if ((event->mask & IN_MOVED_TO) != 0 && watched) l->saved++;
}

static void drain(listener *l) {
    _Alignas(struct inotify_event) char buffer[16384];
    for (ssize_t n; (n = read(l->fd, buffer, sizeof buffer)) > 0;)
        for (char *at = buffer; at < buffer + n;) {
            const struct inotify_event *event = (const void *)at;
            count_event(l, event);
            at += sizeof *event + event->len;
        }
}

/* Waits until `writes` writes have begun, or the process has ended. */
static void wait_for_writes(listener *l, pid_t pid, long writes) {
    struct pollfd on = {l->fd, POLLIN, 0};
    siginfo_t info;
    for (const double begin = seconds_now(); l->begun < writes && seconds_now() < begin + PATIENCE;
         drain(l)) {
        (void)poll(&on, 1, 5);
        info.si_pid = 0;
        if (waitid(P_PID, (id_t)pid, &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid != 0) return;
    }
}

typedef struct killing {
    bench b;
    long begun, saved; /* writes in the uninterrupted run; its checkpoints */
    long end;          /* progress at its end */
    result sum;
} killing;

/* Starts a run and kills it at the drawn moment. Returns false if the run ended before. */
static bool run_killed(killing *k) {
    bench *b = &k->b;
    const job *j = b->job;
    listener l = listen_to(j);
    const bool at_write = k->begun > 0 && lg_rng_uniform(&rng) < 0.5;
    const double wait = at_write ? after_write * lg_rng_uniform(&rng) : b->seconds * lg_rng_uniform(&rng);
    const long writes = 1 + (long)lg_rng_below(&rng, (uint64_t)(k->begun > 0 ? k->begun : 1));
    if (j->appends) b->cut = whole_lines(work(j->outputs[0]));
    const pid_t pid = start(NULL, j, more_of(j));
    if (at_write) wait_for_writes(&l, pid, writes);
    sleep_for(wait);
    const long before = progress(j);
    (void)kill(pid, SIGKILL);
    const int code = wait_for(pid);
    (void)close(l.fd);
    if (code != 1000 + SIGKILL) {
        if (code != 0) fail(b, "exit code %d without a kill", code);
        return false;
    }
    const long after = progress(j);
    k->sum.kills++;
    *(count_left(work(""), ".liegrad-tmp-", true) > 0 ? &k->sum.writing
      : after == 0                                    ? &k->sum.first
                                                      : &k->sum.later) += 1;
    check_cut_short(b, before, after);
    return true;
}

/* Runs the command to its end. */
static void run_rest(killing *k) {
    bench *b = &k->b;
    const job *j = b->job;
    const bool resumes = j->checkpoint != NULL && exists(work(j->checkpoint));
    const long at = progress(j);
    listener l = listen_to(j);
    if (j->appends) b->cut = whole_lines(work(j->outputs[0]));
    const int code = wait_for(start(NULL, j, more_of(j)));
    drain(&l);
    (void)close(l.fd);
    k->sum.resumed += resumes;
    if (code != 0) {
        fail(b, "exit code %d of the run after a kill", code);
        return;
    }
    const long step = k->saved > 0 ? k->end / k->saved : 1;
    if (j->counted && l.saved != k->saved - at / step)
        fail(b, "%ld checkpoints after %ld of %ld, each of %ld", l.saved, at, k->end, step);
    k->sum.equal += outputs_equal(b) && resumes;
    /* each killed lg-export may leave its folder, and nothing else */
    const int files = count_left(work(""), ".liegrad-", false), all = count_left(work(""), ".liegrad-", true);
    const uint64_t allowed = strcmp(j->program, "lg-export") == 0 ? k->sum.kills : 0;
    const int left = files > 0 || (uint64_t)all > allowed ? all : 0;
    k->sum.left += (uint64_t)left;
    if (left > 0) fail(b, "%d temporary files or locks are left", left);
}

/* Kills the command repeatedly, until a random draw ends this or a command with a checkpoint finishes before
 * its kill. */
static void kill_once(killing *k, uint64_t wanted) {
    const uint64_t failures = k->b.failed;
    clean();
    if (k->b.job->keeps && lg_rng_uniform(&rng) < 0.5) put_old(&k->b);
    for (int draw = 0; draw < DRAWS && k->sum.kills < wanted && k->b.failed == failures; draw++) {
        const bool killed = run_killed(k);
        if (killed ? lg_rng_uniform(&rng) > 1.0 / 3 : k->b.job->checkpoint != NULL) break;
    }
    run_rest(k);
}

static void run_unbroken(killing *k) {
    clean_for(&k->b);
    listener l = listen_to(k->b.job);
    note_outputs(&k->b);
    drain(&l);
    (void)close(l.fd);
    k->begun = l.begun;
    k->saved = l.saved;
    k->end = progress(k->b.job);
}

static result run_job(const job *j, uint64_t kills) {
    killing k = {.b.job = j};
    run_unbroken(&k);
    while (k.sum.kills < kills && k.b.failed < 10) kill_once(&k, kills);
    (void)printf("| %s | %.2f | %llu | %llu | %llu | %llu | %llu/%llu | %llu | %llu |\n", j->name,
                 k.b.seconds, (unsigned long long)k.sum.kills, (unsigned long long)k.sum.first,
                 (unsigned long long)k.sum.writing, (unsigned long long)k.sum.later,
                 (unsigned long long)k.sum.equal, (unsigned long long)k.sum.resumed,
                 (unsigned long long)k.sum.left, (unsigned long long)k.b.failed);
    (void)fflush(stdout);
    k.sum.failed = k.b.failed;
    return k.sum;
}

/* ---- all jobs ---- */

int main(int argc, char **argv) {
    uint64_t kills = 32, seed = 1, failed = 0, done = 0, made = 0, chosen = 0;
    const char *only = "";
    for (int c; (c = getopt(argc, argv, "n:s:o:")) != -1;) {
        if (c == 'n') kills = strtoull(optarg, NULL, 10);
        if (c == 's') seed = strtoull(optarg, NULL, 10);
        if (c == 'o') only = optarg;
        if (c == '?') return 2;
    }
    if (optind + 1 != argc) stop("usage: kills FOLDER-OF-EXECUTABLES [-n KILLS] [-s SEED] [-o NAME]");
    lg_rng_seed(&rng, seed, 0);
    make_inputs(argv[optind], false, &rng);
    for (size_t i = 0; i < job_count; i++) chosen += strstr(jobs[i].name, only) != NULL;
    (void)printf(
        "| command | seconds | kills | before a checkpoint | in a write | later | resumes equal | left | "
        "failures |\n|---|---|---|---|---|---|---|---|---|\n");
    for (size_t i = 0; i < job_count; i++) {
        if (strstr(jobs[i].name, only) == NULL) continue;
        made++;
        const result r = run_job(&jobs[i], kills * made / chosen - kills * (made - 1) / chosen);
        failed += r.failed;
        done += r.kills;
    }
    (void)printf("\n%llu kills, %llu failures\n", (unsigned long long)done, (unsigned long long)failed);
    if (failed == 0) remove_inputs();
    return failed > 0;
}
