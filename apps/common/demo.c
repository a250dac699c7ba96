/* The demo of a program: a bash script that runs commands as a user would. */
#include <ctype.h>
#include <errno.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>

#include "common/app.h"

/* Sets LG_NAME for the script. An option that has no default and is not given is empty. */
static void set_variable(const char *option, const char *value) {
    APP_FREE char *name = app_format("LG_%s", option);
    for (char *c = name; *c != '\0'; c++) *c = (char)(*c == '-' ? '_' : toupper((unsigned char)*c));
    if (setenv(name, value, 1) != 0) app_out_of_memory();
}

static void set_variables(const app *self) {
    char text[LG_FIELD_TEXT_SIZE];
    for (const app_slot *slot = self->slots; slot < self->slots + self->slot_count; slot++) {
        lg_field_show(slot->row, slot->values, text, sizeof text);
        set_variable(slot->name, slot->given || slot->row->value != NULL ? text : "");
    }
    APP_FREE char *seed = app_format("%llu", (unsigned long long)self->seed);
    APP_FREE char *threads = app_format("%llu", (unsigned long long)self->threads);
    set_variable("seed", seed);
    set_variable("threads", threads);
    set_variable("json", self->json ? "1" : "");
}

/* Waits for the script, and passes a signal on to it. Returns its exit code. */
static int wait_for_script(const app *self, pid_t child) {
    static const struct timespec pause = {0, 20000000};
    int status = 0;
    pid_t ended;
    for (bool passed = false; (ended = waitpid(child, &status, WNOHANG)) == 0; (void)nanosleep(&pause, NULL))
        if (app_interrupted() && !passed) passed = kill(child, SIGTERM) == 0;
    if (app_interrupted()) return APP_EXIT_INTERRUPTED;
    if (ended < 0) app_stop(self, LG_FILE, "the demo's script: %s", strerror(errno));
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

/* Creates the folder unless it exists. Its parent folder must exist. */
static lg_status make_folder(const char *path, lg_error *error) {
    struct stat information;
    if (mkdir(path, 0777) == 0) return LG_OK;
    const int number = errno;
    if (number == EEXIST && stat(path, &information) == 0 && S_ISDIR(information.st_mode)) return LG_OK;
    return lg_fail(error, LG_FILE, "%s: the folder cannot be made: %s", path, strerror(number));
}

void app_demo(app *self) {
    extern char **environ;
    const lg_named_text *texts = self->command->row;
    const char *folder = app_common_given.out;
    pid_t child;
    APP_MUST_FILE(self, folder, make_folder(folder, &error));
    APP_MUST_FILE(self, folder, app_claim(self, folder, &error));
    app_write_texts(self, folder, texts);
    set_variables(self);
    if (chdir(folder) != 0) app_stop(self, LG_FILE, "%s: %s", folder, strerror(errno));
    APP_FREE char *commands =
        app_format("%s%s", lg_named_text_of(texts, "begin.sh"), lg_named_text_of(texts, "demo.sh"));
    char *words[] = {"bash", "-peu", "-c", commands, self->title, NULL};
    const int failed = posix_spawnp(&child, words[0], NULL, NULL, words, environ);
    if (failed != 0)
        app_stop(self, LG_FILE, "the demo is a bash script, and bash cannot be started: %s",
                 strerror(failed));
    self->code = wait_for_script(self, child);
}
