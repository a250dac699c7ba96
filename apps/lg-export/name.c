/* Chooses and checks the name of a model in C. */
#include "lg-export/export.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { LONGEST = 40 };

/* Names of standard headers, which NAME.h would hide. */
static const char headers[] =
    " assert complex ctype errno fenv float inttypes iso646 limits locale math memory setjmp signal stdalign "
    "stdarg stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string strings tgmath threads time "
    "uchar unistd wchar wctype ";

/* Returns whether a word of the text begins with `name` and _. */
static bool begins_a_word(const char *name, const char *code) {
    const size_t length = strlen(name);
    for (const char *s = code; (s = strstr(s, name)) != NULL; s++)
        if (s[length] == '_' && (s == code || !lg_in_word(s[-1]))) return true;
    return false;
}

const char *export_name_problem(const char *name) {
    char word[LONGEST + 3];
    const size_t length = strlen(name);
    if (length == 0 || length > LONGEST) return "it must have 1 to 40 characters";
    if (!lg_in_word(name[0]) || strchr("0123456789_", name[0]) != NULL) return "it must begin with a letter";
    for (const char *s = name; *s != '\0'; s++)
        if (!lg_in_word(*s)) return "it may have only letters, digits and _";
    if (strstr(name, "__") != NULL || name[length - 1] == '_') return "__ and a _ at the end are reserved";
    (void)snprintf(word, sizeof word, " %s ", name);
    if (lg_program_name_problem(name) != NULL || strstr(headers, word) != NULL)
        return "the word is reserved by C or C++";
    if (strcmp(name, "run") == 0 || strcmp(name, "golden") == 0)
        return "the self-test uses words with this beginning";
    if (strcasecmp(name, "makefile") == 0) return "make treats files of this name as its own";
    for (const lg_named_text *f = export_fragments; f->name != NULL; f++)
        if (strchr(f->name, '.') == NULL && begins_a_word(name, f->text))
            return "the code uses words with this beginning";
    return NULL;
}

/* Writes the letters and digits of the file's name, without its ending, to `out`. Other characters between
 * them become one _. */
static void words_of(const char *file, char *out) {
    const char *dot = strrchr(file, '.');
    const char *end = dot != NULL && dot > file ? dot : file + strlen(file);
    size_t used = 0;
    for (const char *s = file; s < end && used < LONGEST - 8; s++) {
        if (lg_in_word(*s) && *s != '_')
            out[used++] = *s;
        else if (used > 0 && out[used - 1] != '_')
            out[used++] = '_';
    }
    while (used > 0 && out[used - 1] == '_') used--;
    out[used] = '\0';
}

char *export_name_from(const char *file) {
    static const char *const before[] = {"", "model_", "learned_"};
    char words[LONGEST];
    words_of(file, words);
    for (size_t i = 0; i < LG_COUNT(before); i++) {
        char *name = app_format("%s%s", before[i], words);
        if (export_name_problem(name) == NULL) return name;
        free(name);
    }
    return export_name_problem("model") == NULL ? app_format("model") : NULL;
}
