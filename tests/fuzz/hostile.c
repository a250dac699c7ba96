/* Files of a megabyte that are made to take long: every reader of text must be done with each of them in
 * little processor time, so its work must not grow with the square of the file. hostile [NAME...]: only these
 * harnesses. Prints the seconds of each reader's slowest file. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/core.h"
#include "fuzz.h"

enum { MOST = 1 << 20 }; /* bytes, also of a YAML file and of a header of safetensors */
#ifdef LG_SANITIZED
enum { SECONDS = 60 };
#else
enum { SECONDS = 8 };
#endif

/* The file is `head`, many of `piece` with a rising number, and `tail`. */
static const struct kind {
    const char *reader; /* NULL: all of this form */
    fuzz_form form;
    const char *name, *head, *piece, *tail;
} kinds[] = {
    {"grid", FORM_YAML, "anchors", "a:\n", "- &a%u x\n", ""},
    {"grid", FORM_YAML, "anchors and aliases", "a:\n", "- &a%u x\n- *a%u\n", ""},
    {"grid", FORM_YAML, "aliases of aliases", "a: &a [x]\n", "b%u: &a%u [*a, *a]\n", ""},
    {"grid", FORM_YAML, "tag lines", "", "%%TAG !a%u! x\n", "--- \na: 1\n"},
    {"grid", FORM_YAML, "tags", "a:\n", "- !t%u x\n", ""},
    {NULL, FORM_YAML, "keys", "", "k%u: 1\n", ""},
    {NULL, FORM_YAML, "one key", "", "k: 1\n", ""},
    {NULL, FORM_YAML, "keys in brackets", "{a: 1", ", k%u: 1", "}"},
    {"grid", FORM_YAML, "lists in brackets", "a: ", "[", ""},
    {"grid", FORM_YAML, "lists of lists", "a:\n ", "- ", ""},
    {"grid", FORM_YAML, "mappings", "", "? ", ""},
    {"grid", FORM_YAML, "mappings in lists", "a:\n", "- a:\n  - b\n", ""},
    {"grid", FORM_YAML, "a list", "a: [1", ", 1", "]"},
    {"grid", FORM_YAML, "pairs", "a: [", "a: b, ", "]"},
    {"grid", FORM_YAML, "words", "a: x", " x", ""},
    {"grid", FORM_YAML, "lines of a text", "a: |\n", " x\n", ""},
    {"grid", FORM_YAML, "escapes", "a: \"", "\\x41", "\""},
    {"grid", FORM_YAML, "comments", "a: 1\n", "#\n", ""},
    {NULL, FORM_YAML, "documents", "a: 1\n", "---\n", ""},
    {"machine", FORM_YAML, "coordinates", "coordinates:\n", "- {name: x%u, kind: line}\n", ""},
    {"machine", FORM_YAML, "inputs", "inputs: {columns: [a", ", u%u", "]}\n"},
    {"scene", FORM_YAML, "numbers", "system: chain\nlinks: 2\ninitial: {q: [1", ", 1", "]}\n"},
    {"scheme", FORM_YAML, "rows", "kind: commutator-free\nrows:\n", "- [[1]]\n", ""},
    {"grid", FORM_YAML, "numbers", "scene: a\nN: [1", ", 1", "]\n"},
    {"search", FORM_YAML, "ranges", "ranges:\n", "  x%u: {uniform: [0, 1]}\n", ""},
    {"search", FORM_YAML, "choices", "ranges: {x: {choice: [a", ", a%u", "]}}\n"},
    {NULL, FORM_TENSORS, "keys of a tensor", "{\"a\":{\"dtype\":\"F32\",\"shape\":[0],\"data_offsets\":[0,0]",
     ",\"k%u\":1", "}}"},
    {NULL, FORM_TENSORS, "one key", "{\"a\":{\"dtype\":\"F32\"", ",\"k\":1", "}}"},
    {NULL, FORM_TENSORS, "notes", "{\"__metadata__\":{\"a\":\"1\"", ",\"k%u\":\"1\"", "}}"},
    {NULL, FORM_TENSORS, "tensors", "{\"a\":1",
     ",\"a%u\":{\"dtype\":\"F32\",\"shape\":[0],\"data_offsets\":[0,0]}", "}"},
    {NULL, FORM_TENSORS, "dimensions", "{\"a\":{\"dtype\":\"F32\",\"shape\":[1", ",1", "]}}"},
    {NULL, FORM_TENSORS, "anchors", "{\"a\":[1", ",&a%u 1", "]}"},
    {NULL, FORM_BYTES, "one name", "a", ",a", "\n1,2\n"},
    {NULL, FORM_BYTES, "names", "a", ",c%u", "\n1,2\n"},
    {NULL, FORM_BYTES, "quotes", "a,b\n\"", "\"\"", "\n"},
    {NULL, FORM_BYTES, "rows", "t,x,c\n", "1,2,%u\n", ""},
    {NULL, FORM_BYTES, "classes", "t,x,c\n", "1,2,c%u\n", ""},
    {NULL, FORM_BYTES, "empty cells", "t,x,c\n", ",,\n", ""},
    {NULL, FORM_BYTES, "digits", "t,x,c\n1,2,", "7", "\n"},
    {NULL, FORM_BYTES, "blank lines", "t,x,c\n", "\n", ""},
    {NULL, FORM_BYTES, "zero bytes", "", "%c", ""},
    {"log", FORM_BYTES, "rows", "\1t,a,x,u\n", "%u,%u,1,1\n", ""},
    {"log", FORM_BYTES, "runs", "%ct,r,x,v,a,w,u\n", "0,%u,1,1,1,1,1\n1,%u,1,1,1,1,1\n", ""},
    {"log", FORM_BYTES, "no times", "\1t,a,x,u\n", ",%u,1,1\n", ""},
    {"log", FORM_BYTES, "one time", "\1t,a,x,u\n", "1,%u,1,1\n", ""},
};

/* Writes the file; returns its size. */
static size_t make(const struct kind *kind, uint8_t *out) {
    const size_t before = kind->form == FORM_TENSORS ? 8 : 0, end = strlen(kind->tail);
    char piece[256];
    size_t used = before + (size_t)sprintf((char *)out + before, kind->head, 0);
    for (unsigned n = 0;; n++) {
        const unsigned number = strcmp(kind->piece, "%c") == 0 ? 0 : n;
        const size_t more = (size_t)snprintf(piece, sizeof piece, kind->piece, number, number);
        if (used + more + end > MOST) break;
        memcpy(out + used, piece, more);
        used += more;
    }
    memcpy(out + used, kind->tail, end);
    used += end;
    for (size_t i = 0; i < before; i++) out[i] = (uint8_t)((used - before) >> (8 * i));
    return used;
}

/* Runs a reader in a child. Returns its seconds, or -1 if it was ended. */
static double run(const fuzz_harness *harness, const uint8_t *data, size_t size) {
    (void)fflush(stdout);
    const pid_t child = fork();
    if (child == 0) {
        const struct rlimit most = {SECONDS, SECONDS};
        if (setrlimit(RLIMIT_CPU, &most) != 0 || freopen("/dev/null", "w", stdout) == NULL ||
            freopen("/dev/null", "w", stderr) == NULL)
            _exit(1);
        harness->run(data, size);
        _exit(0);
    }
    int status = -1;
    struct rusage use;
    if (wait4(child, &status, 0, &use) != child || !WIFEXITED(status) || WEXITSTATUS(status) != 0) return -1;
    return (double)(use.ru_utime.tv_sec + use.ru_stime.tv_sec) +
           1e-6 * (double)(use.ru_utime.tv_usec + use.ru_stime.tv_usec);
}

static bool is_wanted(const char *name, int argc, char **argv) {
    bool wanted = argc < 2;
    for (int i = 1; i < argc; i++) wanted = wanted || strcmp(argv[i], name) == 0;
    return wanted;
}

int main(int argc, char **argv) {
    int files = 0, failed = 0;
    uint8_t *data = malloc(MOST + 64);
    if (data == NULL) return 1;
    (void)fuzz_file("", 0); /* this process removes the file */
    for (const fuzz_harness *h = fuzz_harnesses; h->name != NULL; h++) {
        const char *slowest = "none";
        double most = 0;
        /* Options are words of the user, and have at most 128 KiB. */
        if (!is_wanted(h->name, argc, argv) || strcmp(h->name, "options") == 0) continue;
        for (size_t i = 0; i < LG_COUNT(kinds); i++) {
            const struct kind *kind = &kinds[i];
            if (kind->form != h->form || (kind->reader != NULL && strcmp(kind->reader, h->name) != 0))
                continue;
            const double seconds = run(h, data, make(kind, data));
            files++;
            failed += seconds < 0;
            if (seconds < 0) (void)printf("%s: %s: not done in %d s\n", h->name, kind->name, SECONDS);
            if (seconds > most) most = seconds, slowest = kind->name;
        }
        if (most > 0) (void)printf("%-8s %6.2f s  %s\n", h->name, most, slowest);
    }
    (void)printf("%d files, %d not done in time\n", files, failed);
    free(data);
    return failed > 0 || files == 0;
}
