/* Writes elementwise operations as C: loops around lines of scalar code. */
#include "autodiff/program/program_c_lines.h"

typedef struct element_ends {
    uint64_t over;   /* bit k: input k and the output share memory */
    const bool *one; /* NULL, or for each input: it is a single number */
    uint32_t levels; /* 0: elements are x[i]; otherwise the number of nested loops */
    const size_t (*stride)[LG_MAX_RANK];
} element_ends;

static void element_input(lg_c *c, lg_text *to, const void *user, uint32_t number) {
    const element_ends *e = user;
    const char *plus = "";
    if (e->over >> number & 1u) {
        lg_text_add(to, e->levels == 0 ? "y[i]" : "*y");
        return;
    }
    lg_text_add(to, "x%u[", number);
    if (e->levels == 0) lg_text_add(to, "%s", e->one != NULL && e->one[number] ? "0" : "i");
    for (uint32_t l = 0; l < e->levels; l++) {
        const size_t stride = e->stride[number][l];
        if (stride == 0) continue;
        lg_text_add(to, "%si%u", plus, l);
        if (stride != 1) lg_text_add(to, " * %zu", stride);
        plus = " + ";
    }
    if (e->levels > 0 && plus[0] == '\0') lg_text_add(to, "0");
    lg_text_add(to, "]");
}

static void element_output(lg_c *c, lg_text *to, const void *user, uint32_t number) {
    lg_text_add(to, "*y++");
}

static void element_output_i(lg_c *c, lg_text *to, const void *user, uint32_t number) {
    lg_text_add(to, "y[i]");
}

/* Makes the scalar code of one element of the operation in `g`. False on failure. */
static bool element_graph(lg_c *c, const lg_op *op, const lg_attr *attr, uint32_t inputs, lg_scalars *s,
                          uint32_t *root, lg_c_graph *g) {
    lg_scalar in[LG_MAX_INPUTS];
    lg_scalars_init(s, c->context);
    for (uint32_t k = 0; k < inputs; k++) in[k] = lg_s_input(s, k);
    *root = op->element(s, attr, in, inputs);
    if (s->failed) return lg_c_fail(c, LG_OUT_OF_MEMORY, "out of memory");
    return lg_c_graph_open(g, c, s->code, s->count, root, 1);
}

/* Whether input k is an argument of the C function: not if forward does not read it or the output overwrites
 * it. */
static bool is_argument(const lg_op *op, const lg_attr *attr, uint32_t inputs, uint64_t over, uint32_t k) {
    const uint32_t unread = op->unread != NULL ? op->unread(attr, inputs) : 0;
    return !(over >> k & 1u) && (k >= 32 || !(unread >> k & 1u));
}

static void add_unused(lg_text *to, const lg_c_graph *g, const lg_op *op, const lg_attr *attr,
                       uint32_t inputs, uint64_t over) {
    for (uint32_t k = 0; k < inputs; k++)
        if (g->shown[k] == 0 && is_argument(op, attr, inputs, over, k))
            lg_text_add(to, "    (void)x%u;\n", k);
}

static void add_parameters(lg_text *to, const lg_op *op, const lg_attr *attr, uint32_t inputs,
                           uint64_t over) {
    for (uint32_t k = 0; k < inputs; k++)
        if (is_argument(op, attr, inputs, over, k)) lg_text_add(to, "const real *RESTRICT x%u, ", k);
    lg_text_add(to, "real *RESTRICT y) {\n");
}

static void add_loops(lg_text *to, uint32_t levels, const size_t *length) {
    if (levels == 0) lg_text_add(to, "    for (int i = 0; i < n; i++) {\n");
    for (uint32_t l = 0; l < levels; l++)
        lg_text_add(to, "%sfor (int i%u = 0; i%u < %zu; i%u++)%s\n", l == 0 ? "    " : "        ", l, l,
                    length[l], l, l + 1 == levels ? " {" : "");
}

/* Bound in bytes on the stack frame of a function with nested loops; it is large because clang unrolls loops
 * over short rows. */
enum { BROADCAST_FRAME = 4096 };

/* Defines a function over all elements: one loop over n elements if user->levels is 0, otherwise nested loops
 * over length[l] elements each. */
static const char *define_elements(lg_c *c, const lg_op *op, const lg_attr *attr, uint32_t inputs,
                                   const element_ends *user, const size_t *length) {
    const lg_c_ends to = {user, element_input, user->levels == 0 ? element_output_i : element_output};
    lg_text lines = {.context = c->context}, text = {.context = c->context};
    lg_scalars s;
    lg_c_graph g = {.c = c};
    uint32_t root;
    const char *name = NULL;
    if (element_graph(c, op, attr, inputs, &s, &root, &g)) {
        lg_c_graph_lines(&g, &lines, "        ", &to, 0, 0);
        lg_text_add(&text, "static NOINLINE void @(%s", user->levels == 0 ? "int n, " : "");
        add_parameters(&text, op, attr, inputs, user->over);
        add_unused(&text, &g, op, attr, inputs, user->over);
        add_loops(&text, user->levels, length);
        lg_c_largest(c, user->levels > 0 ? BROADCAST_FRAME : lg_c_frame_of(&lines));
        lg_text_join(&text, &lines);
        lg_text_add(&text, "    }\n}\n");
        if (lg_c_takes(c, &text)) name = lg_c_define(c, op->name, text.data);
    }
    lg_c_graph_close(&g);
    lg_scalars_destroy(&s);
    lg_text_destroy(&lines);
    lg_text_destroy(&text);
    return name;
}

const char *lg_c_map(lg_c *c, const lg_op *op, const lg_attr *attr, uint32_t inputs, uint64_t over) {
    const element_ends user = {.over = over};
    const char *name = lg_c_good(c) ? define_elements(c, op, attr, inputs, &user, NULL) : NULL;
    return name != NULL ? name : "";
}

/* Sets the lengths of the loops over the output's axes and the inputs' strides, and returns the number of
 * loops. Adjacent axes are merged into one loop if all inputs allow it. */
static uint32_t levels_of(const lg_evaluation *e, size_t length[LG_MAX_RANK], size_t (*stride)[LG_MAX_RANK]) {
    uint32_t levels = 0;
    for (uint32_t d = 0; d < e->shape->rank; d++) {
        size_t own[LG_MAX_INPUTS];
        bool same = levels > 0;
        if (e->shape->dims[d] == 1) continue;
        for (uint32_t k = 0; k < e->inputs; k++) {
            const lg_shape *in = e->in[k];
            const uint32_t missing = e->shape->rank - in->rank;
            own[k] = d >= missing && in->dims[d - missing] != 1 ? 1 : 0;
            for (uint32_t a = d + 1; own[k] > 0 && a < e->shape->rank; a++) own[k] *= in->dims[a - missing];
            same = same && stride[k][levels - 1] == own[k] * e->shape->dims[d];
        }
        if (!same) length[levels++] = 1;
        length[levels - 1] *= e->shape->dims[d];
        for (uint32_t k = 0; k < e->inputs; k++) stride[k][levels - 1] = own[k];
    }
    return levels;
}

static void add_call(lg_c *c, const lg_op *op, const char *name, const lg_evaluation *e, uint64_t over,
                     bool counted) {
    lg_text call = {.context = c->context};
    if (name == NULL) return;
    lg_text_add(&call, "%s(", name);
    if (counted) lg_text_add(&call, "%zu, ", e->count);
    for (uint32_t k = 0; k < e->inputs; k++)
        if (is_argument(op, e->attr, e->inputs, over, k)) lg_text_add(&call, "$%u, ", k);
    lg_text_add(&call, "$y)");
    if (lg_c_takes(c, &call)) lg_c_call(c, "%s", call.data);
    lg_text_destroy(&call);
}

/* If every input has the output's shape or is a single number, one loop over all elements is written. */
void lg_c_elementwise(lg_c *c, const lg_op *op, const lg_evaluation *e) {
    size_t length[LG_MAX_RANK], stride[LG_MAX_INPUTS][LG_MAX_RANK] = {{0}};
    bool one[LG_MAX_INPUTS];
    const uint32_t levels = levels_of(e, length, stride);
    uint64_t over = 0;
    for (uint32_t k = 0; k < e->inputs; k++) {
        /* An input that is not read is marked, too, because neither kind becomes an argument. */
        if (c->step->x[k].area == LG_AREA_NONE || lg_same_place(&c->step->x[k], &c->step->y))
            over |= (uint64_t)1 << k;
        one[k] = levels == 1 && stride[k][0] == 0;
    }
    const bool single = levels <= 1;
    const element_ends user = {over, one, single ? 0 : levels, (const size_t(*)[LG_MAX_RANK])stride};
    add_call(c, op, define_elements(c, op, e->attr, e->inputs, &user, length), e, over, single);
}
