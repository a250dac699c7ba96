/* Changes of YAML files: what was asked for is there afterwards, and everything else is as it was. */
#include <yaml.h>

#include "settings/files/yaml.h"
#include "settings/files/yaml_edit.h"
#include "liegrad/machine.h"
#include "support/io_test.h"

/* ---- files as lists of leaves: one line "path=text" for each scalar, in the order of the file ---- */

typedef struct leaves {
    char text[8192];
    size_t used;
} leaves;

static void walk(yaml_document_t *document, int index, const char *path, leaves *out) {
    const yaml_node_t *node = yaml_document_get_node(document, index);
    char below[400];
    if (node->type == YAML_SCALAR_NODE) {
        out->used += (size_t)snprintf(out->text + out->used, sizeof out->text - out->used, "%s=%s\n", path,
                                      (const char *)node->data.scalar.value);
    } else if (node->type == YAML_SEQUENCE_NODE) {
        int i = 0;
        for (yaml_node_item_t *item = node->data.sequence.items.start; item < node->data.sequence.items.top;
             item++) {
            (void)snprintf(below, sizeof below, "%s[%d]", path, i++);
            walk(document, *item, below, out);
        }
    } else {
        for (yaml_node_pair_t *p = node->data.mapping.pairs.start; p < node->data.mapping.pairs.top; p++) {
            const yaml_node_t *key = yaml_document_get_node(document, p->key);
            (void)snprintf(below, sizeof below, "%s%s%s", path, *path != '\0' ? "." : "",
                           (const char *)key->data.scalar.value);
            walk(document, p->value, below, out);
        }
    }
    assert_true(out->used < sizeof out->text - 1);
}

static const char *leaves_of(const char *text) {
    leaves *out = TEST_ARRAY(leaves, 1);
    lg_yaml *yaml = NULL;
    assert_told(lg_yaml_open_text(NULL, "file.yaml", text, strlen(text), &yaml, &told));
    walk(lg_yaml_document(yaml), 1, "", out);
    lg_yaml_close(yaml);
    return out->text;
}

static void release_text(void *text) {
    lg_free(NULL, text);
}

static const char *changed(const char *text, const lg_yaml_edit *edits, size_t count) {
    char *out = NULL;
    assert_told(lg_yaml_change(NULL, "file.yaml", text, edits, count, &out, &told));
    lg_test_owns(out, release_text);
    return out;
}

/* ---- examples ---- */

static const char file[] = "# a cart\n"
                           "coordinates:\n"
                           "  - {name: x, kind: line, velocity: \"vx\"} # its place\n"
                           "inputs: {columns: [u]}\n"
                           "damping: {kind: diagonal, coulomb: true}\n"
                           "residual: none\n";
#define BEFORE "coordinates[0].name=x\ncoordinates[0].kind=line\ncoordinates[0].velocity=vx\n"

static void assert_change(lg_yaml_edit edit, const char *expected) {
    assert_string_equal(leaves_of(changed(file, &edit, 1)), expected);
}

TEST("a value is set, also below keys that the file does not have") {
    assert_change((lg_yaml_edit){LG_YAML_SET, "inputs.hold", NULL, "cubic"}, BEFORE
                  "inputs.columns[0]=u\ninputs.hold=cubic\ndamping.kind=diagonal\ndamping.coulomb=true\n"
                  "residual=none\n");
    assert_change((lg_yaml_edit){LG_YAML_SET, "inputs.columns", NULL, "[a, b]"}, BEFORE
                  "inputs.columns[0]=a\ninputs.columns[1]=b\ndamping.kind=diagonal\ndamping.coulomb=true\n"
                  "residual=none\n");
    assert_change((lg_yaml_edit){LG_YAML_SET, "columns.time", NULL, "s"},
                  BEFORE "inputs.columns[0]=u\ndamping.kind=diagonal\ndamping.coulomb=true\nresidual=none\n"
                         "columns.time=s\n");
}

TEST("an item is appended to a list, to a single value, to none and to nothing") {
    assert_change((lg_yaml_edit){LG_YAML_APPEND, "damping", NULL, "{kind: cubic}"},
                  BEFORE "inputs.columns[0]=u\ndamping[0].kind=diagonal\ndamping[0].coulomb=true\n"
                         "damping[1].kind=cubic\nresidual=none\n");
    assert_change(
        (lg_yaml_edit){LG_YAML_APPEND, "residual", NULL, "{kind: network}"},
        BEFORE "inputs.columns[0]=u\ndamping.kind=diagonal\ndamping.coulomb=true\nresidual.kind=network\n");
    assert_change((lg_yaml_edit){LG_YAML_APPEND, "potential", NULL, "{kind: linear}"},
                  BEFORE "inputs.columns[0]=u\ndamping.kind=diagonal\ndamping.coulomb=true\nresidual=none\n"
                         "potential.kind=linear\n");
    assert_change((lg_yaml_edit){LG_YAML_APPEND, "inputs.columns", NULL, "w"}, BEFORE
                  "inputs.columns[0]=u\ninputs.columns[1]=w\ndamping.kind=diagonal\ndamping.coulomb=true\n"
                  "residual=none\n");
}

TEST("a term is replaced by its kind") {
    assert_change((lg_yaml_edit){LG_YAML_REPLACE, "damping", "diagonal", "{kind: asymmetric}"}, BEFORE
                  "inputs.columns[0]=u\ndamping.kind=asymmetric\ndamping.coulomb=true\nresidual=none\n");
    assert_change((lg_yaml_edit){LG_YAML_REPLACE, "damping", "cubic", "stribeck"},
                  BEFORE "inputs.columns[0]=u\ndamping[0].kind=diagonal\ndamping[0].coulomb=true\n"
                         "damping[1]=stribeck\nresidual=none\n");
    assert_change((lg_yaml_edit){LG_YAML_REPLACE, "damping", "diagonal", "full"},
                  BEFORE "inputs.columns[0]=u\ndamping.kind=full\ndamping.coulomb=true\nresidual=none\n");
    assert_change((lg_yaml_edit){LG_YAML_REPLACE, "mass", "diagonal", "full"},
                  BEFORE "inputs.columns[0]=u\ndamping.kind=diagonal\ndamping.coulomb=true\nresidual=none\n"
                         "mass=full\n");
    const lg_yaml_edit two[] = {{LG_YAML_APPEND, "damping", NULL, "quadratic"},
                                {LG_YAML_REPLACE, "damping", "quadratic", "{kind: cubic, values: [2]}"}};
    assert_string_equal(leaves_of(changed(file, two, 2)),
                        BEFORE "inputs.columns[0]=u\ndamping[0].kind=diagonal\ndamping[0].coulomb=true\n"
                               "damping[1].kind=cubic\ndamping[1].values[0]=2\nresidual=none\n");
}

TEST("an edit replaces the term with the same coordinates") {
    static const char terms[] =
        "terms: [{kind: a, of: x}, {kind: a, of: [y]}, {kind: a, of: [x, y]}, b, c]\n";
    static const struct {
        const char *old, *fragment, *expected;
    } rows[] = {{"a", "{kind: d, of: [x]}",
                 "[0].kind=d\n[0].of[0]=x\n[1].kind=a\n[1].of[0]=y\n[2].kind=a\n[2].of[0]=x\n[2].of[1]=y\n"
                 "[3]=b\n[4]=c\n"},
                {"a", "{kind: d, of: y}",
                 "[0].kind=a\n[0].of=x\n[1].kind=d\n[1].of=y\n[2].kind=a\n[2].of[0]=x\n[2].of[1]=y\n"
                 "[3]=b\n[4]=c\n"},
                {"a", "{kind: d, of: [x, y]}",
                 "[0].kind=a\n[0].of=x\n[1].kind=a\n[1].of[0]=y\n[2].kind=a\n[2].of[0]=x\n[2].of[1]=y\n"
                 "[3]=b\n[4]=c\n[5].kind=d\n[5].of[0]=x\n[5].of[1]=y\n"},
                {"c", "e",
                 "[0].kind=a\n[0].of=x\n[1].kind=a\n[1].of[0]=y\n[2].kind=a\n[2].of[0]=x\n[2].of[1]=y\n"
                 "[3]=b\n[4]=e\n"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_yaml_edit edit = {LG_YAML_REPLACE, "terms", rows[i].old, rows[i].fragment};
        const char *now = leaves_of(changed(terms, &edit, 1));
        for (const char *line = now, *want = rows[i].expected; *want != '\0';) {
            const size_t length = strcspn(want, "\n") + 1;
            assert_memory_equal(line, "terms", 5);
            assert_memory_equal(line + 5, want, length);
            line += 5 + length;
            want += length;
        }
    }
}

TEST("a file of many keys is written completely") {
    char *text = test_text("%*s", 60000, "");
    size_t used = 0;
    for (int i = 0; i < 1500; i++)
        used += (size_t)sprintf(text + used, "key_%04d: value of a key with %04d\n", i, i);
    const lg_yaml_edit edit = {LG_YAML_SET, "key_0007", NULL, "7"};
    const char *now = changed(text, &edit, 1);
    assert_true(strlen(now) > 40000);
    assert_says(now, "key_0006: value of a key with 0006\nkey_0007: 7\nkey_0008: value");
    assert_says(now, "key_1499: value of a key with 1499\n");
}

/* ---- values that a table of fields refuses ---- */

static lg_status parse_even(const char *text, void *member, lg_error *error) {
    if (strlen(text) % 2 == 1) return lg_fail(error, LG_INVALID_ARGUMENT, "its length is odd");
    memcpy(member, text, 2);
    return LG_OK;
}

TEST("values that do not fit their field are refused with the line and the field") {
    static const char *const kinds[] = {"a", "b", NULL};
    static const lg_field keys[] = {
        {.name = "number", .type = LG_FIELD_REAL, .low = -5, .high = 5},
        {.name = "count", .type = LG_FIELD_U32, .low = 1, .high = 9},
        {.name = "big", .type = LG_FIELD_U64, .low = 0, .high = 0x1p64},
        {.name = "kind", .type = LG_FIELD_NAME, .names = kinds},
        {.name = "list", .type = LG_FIELD_REALS, .low = -5, .high = 5, .most = 3},
        {.name = "long", .type = LG_FIELD_REALS, .low = -5, .high = 5, .most = 100},
        {.name = "phrase", .type = LG_FIELD_PHRASE, .size = 2, .parse = parse_even},
        {.name = "map", .type = LG_FIELD_MAP},
        {.name = "map.inner", .type = LG_FIELD_REAL, .low = -5, .high = 5}};
#define X8  "xxxxxxxx"
#define X64 X8 X8 X8 X8 X8 X8 X8 X8
    static const struct {
        const char *text, *words;
    } rows[] = {
        {"number: [1]", "line 1: number: a number is expected"},
        {"number: \"a\\x7fb\\x01\"", "number: 'a?b?' is not a number"},
        {"number: " X64 X64, "is not a number"},
        {"number: '1'", "'1' is not a number"},
        {"count: -1", "count: '-1' is not a whole number"},
        {"count: 1.5", "count: '1.5' is not a whole number"},
        {"count: 10", "count: 10 is outside [1, 9]"},
        {"big: [1]", "big: a whole number is expected"},
        {"big: '12'", "big: '12' is not a whole number"},
        {"big: 1" X64, "is not a whole number"},
        {"big: 1x", "big: '1x' is not a whole number"},
        {"kind: [a]", "kind: a name is expected"},
        {"kind: c", "kind: 'c' is none of a, b"},
        {"kind: " X64, "is none of a, b"},
        {"list: {a: 1}", "list: a list is expected"},
        {"list: [1, 2, 3, 4]", "list: has 4 values, 1 to 3 are expected"},
        {"long: [0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0]", "too many values"},
        {"phrase: []", "phrase: a text"},
        {"phrase: odd", "phrase: its length is odd"},
        {"map: 3", "map: keys and values are expected"},
        {"map: {" X64 ": 3}", "unknown key"},
        {"number: 1\n---\n[", "is not YAML"},
        {"number: 1\nphrase: even\n" X64 ": 2", "unknown key"}};
    lg_key_value values[LG_COUNT(keys)];
    const lg_key_set set = {keys, LG_COUNT(keys), values};
    lg_yaml *yaml = NULL;
    char member[2];
    lg_error error;
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_status status =
            lg_yaml_open_text(NULL, "file.yaml", rows[i].text, strlen(rows[i].text), &yaml, &error);
        if (status == LG_OK) {
            status = lg_yaml_read(yaml, &set, 1, NULL, "", &error);
            assert_false(lg_yaml_has(yaml, "number.inner") || lg_yaml_has(yaml, "nothing"));
            if (status == LG_OK) status = lg_yaml_store(yaml, keys, values, LG_COUNT(keys), member, &error);
            lg_yaml_close(yaml);
        }
        assert_int_equal(status, LG_FORMAT);
        assert_says(error.message, rows[i].words);
    }
    const size_t large = ((size_t)1 << 20) + 1;
    char *text = memset(lg_test_memory(large), 'a', large);
    assert_int_equal(lg_yaml_open_text(NULL, "file.yaml", text, large, &yaml, &error), LG_FORMAT);
    unsigned char *bytes = NULL;
    size_t size;
    for (int i = 0; i < 2; i++)
        assert_int_equal(lg_yaml_bytes(NULL, i == 0 ? NULL : "", &bytes, &size, &error), LG_INVALID_ARGUMENT);
}

TEST("what libyaml takes long for is refused with its line, and texts may look like it") {
#define NEST8 "[[[[[[[["
#define ENDS8 "]]]]]]]]"
    static const struct {
        const char *text, *words; /* NULL: is read */
    } rows[] = {{"a: 1\nb: &one {kind: x}", "line 2: anchors (&) and aliases (*) are not read"},
                {"a: [1,\n *one]", "line 2: anchors (&) and aliases (*) are not read"},
                {"%TAG !a! x\n---\na: 1", "line 1: %TAG is not read"},
                {"a: " NEST8 NEST8 "1" ENDS8 ENDS8, "line 1: lists and mappings are nested too deep"},
                {"a:\n - - - - - - - - - - - - - - - - 1", "line 2: lists and mappings are nested too deep"},
                {ENDS8 "\na: " NEST8 NEST8, "line 2: lists and mappings are nested too deep"},
                {"a: '&one *two'\nb: \"%TAG\" # &three [[[[[[[[[[[[[[[[[[[[", NULL},
                {"a: " NEST8 "[[[[[[[1" ENDS8 "]]]]]]]", NULL},
                {"a: !!str x\nb: R&D", NULL}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_yaml *yaml = NULL;
        lg_error error = {LG_OK, ""};
        const lg_status status =
            lg_yaml_open_text(NULL, "file.yaml", rows[i].text, strlen(rows[i].text), &yaml, &error);
        assert_int_equal(status, rows[i].words != NULL ? LG_FORMAT : LG_OK);
        if (rows[i].words != NULL) assert_says(error.message, rows[i].words);
        if (status == LG_OK) lg_yaml_close(yaml);
    }
}

TEST("what is not YAML, or has no room for the key, is refused with a sentence") {
    static const struct {
        const char *text, *path, *fragment, *words;
    } rows[] = {{"a: [1", "b", "2", "is not YAML"},
                {"a: 1\nc: 3", "b", "{x: ", "is not YAML"},
                {"a: 1\nc: 3", "c.d", "2", "line 2: c.d: keys and values are expected above this key"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        char *out = NULL;
        lg_error error = {LG_OK, ""};
        const lg_yaml_edit edit = {LG_YAML_SET, rows[i].path, NULL, rows[i].fragment};
        assert_int_equal(lg_yaml_change(NULL, "file.yaml", rows[i].text, &edit, 1, &out, &error), LG_FORMAT);
        assert_null(out);
        assert_says(error.message, rows[i].words);
    }
}

/* ---- property: random machine files ---- */

static const char *pick(lg_rng *rng, const char *const *from, size_t count) {
    return from[lg_rng_below(rng, count)];
}
#define PICK(rng, ...)                                                                                       \
    pick(rng, (const char *const[]){__VA_ARGS__}, LG_COUNT(((const char *const[]){__VA_ARGS__})))

/* A machine of one or two lines with one input. */
static const char *random_machine(lg_rng *rng) {
    const bool two = lg_rng_below(rng, 2) == 1;
    return test_text(
        "%scolumns: {time: t%s}\ncoordinates:\n  - {name: x, kind: line, velocity: %s}\n%sinputs: %s\n"
        "mass: %s\ndamping: %s\n%spotential: %s\ninput_map: {kind: known, values: %s}\n%s",
        PICK(rng, "", "# machine\n", "---\n"), PICK(rng, "", ", max_step: 0.5"),
        PICK(rng, "vx", "'vx'", "\"v x\""),
        two ? PICK(rng, "  - {name: y, kind: angle, velocity: vy}\n",
                   "  - name: y # an angle\n    kind: angle\n    velocity: [vy]\n")
            : "",
        PICK(rng, "{columns: [u]}", "{columns: u, hold: linear}", "{columns: [u], delay: 2}",
             "\n  columns:\n    - u\n  hold: zero"),
        PICK(rng, "diagonal", "constant", "{kind: diagonal}"),
        PICK(rng, "diagonal", "none", "{kind: diagonal, coulomb: true}", "[diagonal, quadratic]",
             "\n  - {kind: diagonal}\n  - kind: coulomb\n    coulomb_width: 0.1",
             "{kind: none, quadratic: true}"),
        PICK(rng, "", "residual: {kind: polynomial, of: x, degree: 2}\n"),
        PICK(rng, "none", "{kind: polynomial, of: [x], degree: 3}", "[{kind: linear, of: x}]"),
        two ? "[[1], [0]]" : "[[2.5]]", PICK(rng, "", "measured: velocities\n", "noise: {x: 1e-3}\n"));
}

static bool below(const char *line, const char *path) {
    const size_t length = strlen(path);
    return strncmp(line, path, length) == 0 && strchr("=.[", line[length]) != NULL;
}

/* The leaves below a path, or all others. */
static const char *part_of(const char *all, const char *path, bool inside) {
    char *out = TEST_ARRAY(char, strlen(all) + 1);
    for (const char *line = all; *line != '\0'; line = strchr(line, '\n') + 1)
        if (below(line, path) == inside) strncat(out, line, (size_t)(strchr(line, '\n') - line) + 1);
    return out;
}

static void assert_edit(const char *text, lg_yaml_edit edit) {
    const char *after = changed(text, &edit, 1), *had = leaves_of(text), *has = leaves_of(after);
    if (strcmp(part_of(had, edit.path, false), part_of(has, edit.path, false)) != 0)
        fail_msg("%s of %s changed more:\n%s\n->\n%s", edit.path, edit.fragment, text, after);
    const char *given = leaves_of(test_text("%s: %s\n", edit.path, edit.fragment));
    const char *now = part_of(has, edit.path, true), *was = part_of(had, edit.path, true);
    if (edit.how == LG_YAML_SET || *was == '\0' || strcmp(was, test_text("%s=none\n", edit.path)) == 0) {
        assert_string_equal(now, given);
        return;
    }
    const bool list = was[strlen(edit.path)] == '[';
    int items = 1;
    for (const char *line = was; list && *line != '\0'; line = strchr(line, '\n') + 1)
        items = atoi(line + strlen(edit.path) + 1) + 1;
    leaves *first = TEST_ARRAY(leaves, 1);
    for (const char *line = list ? "" : was; *line != '\0'; line = strchr(line, '\n') + 1)
        first->used += (size_t)sprintf(first->text + first->used, "%s[0]%.*s", edit.path,
                                       (int)(strchr(line, '\n') - line) + 1 - (int)strlen(edit.path),
                                       line + strlen(edit.path));
    assert_string_equal(
        now, test_text("%s%s[%d]%s", list ? was : first->text, edit.path, items, given + strlen(edit.path)));
}

TEST("in random machine files an edit adds what was asked for and changes nothing else") {
    static const lg_yaml_edit edits[] = {{LG_YAML_SET, "inputs.hold", NULL, "cubic"},
                                         {LG_YAML_SET, "inputs.delay", NULL, "3"},
                                         {LG_YAML_SET, "scale.x", NULL, "2"},
                                         {LG_YAML_SET, "damping", NULL, "[a, b]"},
                                         {LG_YAML_APPEND, "damping", NULL, "cubic"},
                                         {LG_YAML_APPEND, "potential", NULL, "{kind: quadratic}"},
                                         {LG_YAML_APPEND, "residual", NULL, "network"}};
    lg_rng rng = test_rng(36, 1);
    for (int round = 0; round < 300; round++) {
        const size_t mark = lg_test_owned();
        assert_edit(random_machine(&rng), edits[lg_rng_below(&rng, LG_COUNT(edits))]);
        lg_test_give_back(mark);
    }
}

RELEASES(release_machine, lg_machine_file_destroy)

static lg_machine_file *machine_of(const char *text) {
    lg_machine_file *out = TEST_ARRAY(lg_machine_file, 1);
    assert_told(lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), out, &told));
    lg_test_owns(out, release_machine);
    return out;
}

TEST("random machine files are read again as the same machine, with the edited setting") {
    lg_rng rng = test_rng(36, 2);
    for (int round = 0; round < 300; round++) {
        const size_t mark = lg_test_owned();
        const char *text = random_machine(&rng);
        const lg_yaml_edit edit = {LG_YAML_SET, "inputs.hold", NULL, "cubic"};
        lg_machine_file *before = machine_of(text), *after = machine_of(changed(text, &edit, 1));
        assert_int_equal(after->inputs[0].hold, LG_HOLD_CUBIC);
        assert_int_equal(after->inputs[0].delay, before->inputs[0].delay);
        assert_memory_equal(after->columns, before->columns, sizeof before->columns);
        assert_memory_equal(&after->machine, &before->machine, sizeof before->machine);
        lg_test_give_back(mark);
    }
}
