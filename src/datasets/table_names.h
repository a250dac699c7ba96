/* Column names in comma-separated lists. Used by the table reader and lg-fit. */
#ifndef LG_TABLE_NAMES_H
#define LG_TABLE_NAMES_H

#include <string.h>

#include "liegrad/table.h"

enum { LG_TABLE_QUOTED = 2 * LG_TABLE_NAME + 2 };
/* Formats a name for a list with commas. Names with a comma, a quote or a blank at an end are quoted, as in
 * CSV. Returns `out` (LG_TABLE_QUOTED bytes). The name must be shorter than LG_TABLE_NAME. */
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
