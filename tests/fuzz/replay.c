/* Runs the corpora without a fuzzer: replay NAME FILE|FOLDER ... runs every file through the harness once.
 * Also: replay list; replay pack FILE.h5 TREE and replay unpack TREE FILE.h5 convert between HDF5 and
 * trees. */
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "fuzz.h"
#include "tree.h"

static uint8_t *read_whole(const char *path, size_t *size) {
    enum { MOST = 1 << 20 };
    FILE *from = fopen(path, "rb");
    uint8_t *bytes = malloc(MOST);
    if (from == NULL || bytes == NULL) {
        perror(path);
        exit(1);
    }
    *size = fread(bytes, 1, MOST, from);
    (void)fclose(from);
    return bytes;
}

static int runs;

static void run_file(const fuzz_harness *harness, const char *path) {
    size_t size;
    uint8_t *bytes = read_whole(path, &size);
    /* exactly this size, so that sanitizers see accesses beyond it */
    uint8_t *exact = malloc(size > 0 ? size : 1);
    if (exact == NULL) exit(1);
    memcpy(exact, bytes, size);
    free(bytes);
    if (getenv("LIEGRAD_FUZZ_NAMES") != NULL) (void)fprintf(stderr, "%s\n", path);
    harness->run(exact, size < harness->most ? size : harness->most);
    free(exact);
    runs++;
}

static void run_path(const fuzz_harness *harness, const char *path) {
    struct stat about;
    struct dirent **names;
    if (stat(path, &about) != 0 || !S_ISDIR(about.st_mode)) {
        run_file(harness, path);
        return;
    }
    const int count = scandir(path, &names, NULL, alphasort);
    for (int i = 0; i < count; i++) {
        char name[4096];
        if (names[i]->d_name[0] != '.' &&
            snprintf(name, sizeof name, "%s/%s", path, names[i]->d_name) < (int)sizeof name)
            run_file(harness, name);
        free(names[i]);
    }
    if (count >= 0) free(names);
}

#ifndef LG_FUZZ_STANDIN
static int pack(const char *from, const char *to) {
    enum { MOST = 1 << 16 };
    static uint8_t out[MOST];
    size_t size = 0;
    if (tree_pack(from, out, sizeof out, &size) != 0) return 1;
    FILE *file = fopen(to, "wb");
    const int whole = file != NULL && fwrite(out, 1, size, file) == size;
    if (file != NULL && fclose(file) == 0 && whole) return 0;
    perror(to);
    return 1;
}

static int unpack(const char *from, const char *to) {
    size_t size;
    uint8_t *bytes = read_whole(from, &size);
    const int code = tree_unpack(bytes, size, to);
    free(bytes);
    return code;
}
#endif

int main(int argc, char **argv) {
    if (argc == 2 && strcmp(argv[1], "list") == 0) {
        for (const fuzz_harness *h = fuzz_harnesses; h->name != NULL; h++)
            (void)printf("%s %zu %s %s\n", h->name, h->most, h->form == FORM_TREE ? "tree" : "text",
                         h->reader);
        return 0;
    }
#ifndef LG_FUZZ_STANDIN
    if (argc == 4 && strcmp(argv[1], "pack") == 0) return pack(argv[2], argv[3]);
    if (argc == 4 && strcmp(argv[1], "unpack") == 0) return unpack(argv[2], argv[3]);
#endif
    const fuzz_harness *harness = argc > 2 ? fuzz_find(argv[1]) : NULL;
    if (harness == NULL) {
        (void)fprintf(stderr, "usage: replay NAME FILE|FOLDER ... | list | pack FILE.h5 TREE | unpack TREE "
                              "FILE.h5\n");
        return 2;
    }
    if (freopen("/dev/null", "w", stdout) == NULL) return 1; /* the output of readers is not needed */
    for (int i = 2; i < argc; i++) run_path(harness, argv[i]);
    (void)fprintf(stderr, "%s: %d inputs; readers accepted %zu and rejected %zu\n", harness->name, runs,
                  fuzz_returned[1], fuzz_returned[0]);
    return runs > 0 && (fuzz_returned[0] == 0 || fuzz_returned[1] > 0) ? 0 : 1;
}
