/* The table of commands for scripts:
 *
 *     list_commands EXECUTABLES       makes a folder with the inputs of short runs and prints its name. Then
 *                                     prints a line for each command that has outputs. Tabs separate the
 *                                     fields: name, program, arguments, checkpoint, options that continue the
 *                                     command, "appends", "adds", "keeps" or "" (commands.h), outputs
 *     list_commands -d FILE|FOLDER/   prints the hash of what must be equal in two results (digest.h) */
#include "crash/commands.h"

#include <stdio.h>

static void print_job(const job *j) {
    char words[2048];
    if (j->outputs[0] == NULL) return;
    resolve(j->arguments, words, sizeof words);
    (void)printf("%s\t%s\t%s\t%s\t%s\t%s", j->name, j->program, words,
                 j->checkpoint != NULL ? j->checkpoint : "", j->again != NULL ? j->again : "",
                 j->appends ? "appends"
                 : j->keeps ? "keeps"
                            : "");
    for (int i = 0; i < OUTPUTS && j->outputs[i] != NULL; i++) (void)printf("\t%s", j->outputs[i]);
    (void)printf("\n");
}

int main(int argc, char **argv) {
    char text[LG_SHA256_TEXT];
    static const job plain = {.name = ""};
    if (argc == 3 && strcmp(argv[1], "-d") == 0) {
        if (!digest(&plain, argv[2], text)) stop("%s is not complete", argv[2]);
        (void)printf("%s\n", text);
        return 0;
    }
    if (argc != 2) stop("usage: list_commands EXECUTABLES | -d FILE");
    lg_rng rng;
    lg_rng_seed(&rng, 1, 0);
    (void)printf("%s\n", make_inputs(argv[1], true, &rng));
    for (size_t i = 0; i < job_count; i++) print_job(&jobs[i]);
    return 0;
}
