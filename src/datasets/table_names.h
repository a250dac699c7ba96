/* Names of columns in lists; the reader and lg-fit share it. */
#ifndef LG_TABLE_NAMES_H
#define LG_TABLE_NAMES_H

#include <string.h>

#include "liegrad/tables.h"

enum { LG_TABLE_QUOTED = 2 * LG_TABLE_NAME + 2 };
/* The name as it stands in a list with commas: in quotes, as in CSV, where it has a comma, a quote or a blank
 * at an end. `out` (LG_TABLE_QUOTED) is returned; the name is shorter than LG_TABLE_NAME. */
static inline const char *lg_table_quote(const char *name, char *out) {
    const size_t length = strlen(name);
    const bool plain =
        strpbrk(name, ",\"") == NULL && length > 0 && name[0] != ' ' && name[length - 1] != ' ';
    size_t used = 0;
    if (!plain) out[used++] = '"';
    for (const char *c = name; *c != '\0'; c++) {
        if (*c == '"') out[used++] = '"';
        out[used++] = *c;
    }
    if (!plain) out[used++] = '"';
    out[used] = '\0';
    return out;
}

#endif
