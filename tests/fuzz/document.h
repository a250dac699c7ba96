/* A YAML document as nodes that mutations can move. Node 0 is the root. The children of a mapping are its
 * keys and values in turn. */
#ifndef LG_FUZZ_DOCUMENT_H
#define LG_FUZZ_DOCUMENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { DOCUMENT_NODES = 1024, DOCUMENT_TEXT = 1 << 15, NO_NODE = -1 };
typedef enum document_kind { DOCUMENT_SCALAR, DOCUMENT_LIST, DOCUMENT_MAP } document_kind;
typedef struct document_node {
    document_kind kind;
    bool quoted;         /* a scalar in quotes; otherwise its text is written as it is, also if it is YAML */
    uint16_t length;     /* of the text */
    const char *text;    /* in the document's text */
    int first, next;     /* child, sibling; NO_NODE */
    int parent, ordinal; /* set by document_list: its parent and its number among the siblings */
} document_node;

typedef struct document {
    document_node node[DOCUMENT_NODES];
    int count; /* of nodes, also of those that no parent has any more */
    char text[DOCUMENT_TEXT];
    size_t used;
    int listed[DOCUMENT_NODES], list_count; /* by document_list: all nodes below the root, and the root */
} document;

/* Returns false if the bytes are not one YAML document that fits. */
bool document_load(document *d, const uint8_t *data, size_t size);
/* Writes the document, cut to `most` bytes. `block`: the entries of the root have lines; otherwise the whole
 * document is in one line, with braces. */
size_t document_write(const document *d, bool block, uint8_t *out, size_t most);
void document_list(document *d);

/* New nodes; NO_NODE or false if there is no room. The copy of a node shares its children. */
int document_scalar(document *d, bool quoted, const char *text, size_t length);
int document_copy(document *d, int from);
bool document_insert(document *d, int parent, int before, int node); /* before NO_NODE: at the end */
void document_remove(document *d, int parent, int node);
int document_child(const document *d, int parent, int ordinal);     /* NO_NODE: there are fewer */
bool document_is_within(const document *d, int node, int ancestor); /* after document_list */
bool document_says(const document *d, int node, const char *text);

#endif
