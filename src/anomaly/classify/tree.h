/* Functions that growing and pruning of decision trees share. */
#ifndef LG_CLASSIFY_TREE_H
#define LG_CLASSIFY_TREE_H

#include "liegrad/classify.h"

/* A copy in depth-first order, left before right, in which the nodes with cut[i] are leaves (NULL: none cut).
 */
lg_status lg_tree_compact(const lg_context *context, const lg_tree *tree, const bool *cut, lg_tree *out);

#endif
