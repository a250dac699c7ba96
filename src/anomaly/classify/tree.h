/* Functions shared by the growing and the pruning of decision trees. */
#ifndef LG_CLASSIFY_TREE_H
#define LG_CLASSIFY_TREE_H

#include "liegrad/classify.h"

/* Copies a tree into depth-first order, left before right. A node with cut[i] becomes a leaf, and the nodes
 * below it are dropped. cut = NULL copies all nodes. */
lg_status lg_tree_compact(const lg_context *context, const lg_tree *tree, const bool *cut, lg_tree *out);

#endif
