/* YAML files: values that do not fit, and machine files with changes behind them. */
#include "settings/files/yaml.h"

#include "liegrad/machine.h"
#include "support/io_test.h"

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

/* ---- random machine files ---- */

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

RELEASES(release_machine, lg_machine_file_destroy)

static lg_machine_file *machine_of(const char *text) {
    lg_machine_file *out = TEST_ARRAY(lg_machine_file, 1);
    assert_told(lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), out, &told));
    lg_test_owns(out, release_machine);
    return out;
}

/* The machine's file with changes behind it, one document each. */
static const char *changed(const char *text, const char *changes) {
    return test_text("%s\n---\n%s\n", text, changes);
}

TEST("random machine files with a change are the same machine, with the changed setting") {
    lg_rng rng = test_rng(36, 2);
    for (int round = 0; round < 300; round++) {
        const size_t mark = lg_test_owned();
        const char *text = random_machine(&rng);
        lg_machine_file *before = machine_of(text),
                        *after = machine_of(changed(text, "inputs: {hold: cubic}"));
        assert_int_equal(after->inputs[0].hold, LG_HOLD_CUBIC);
        assert_int_equal(after->inputs[0].delay, before->inputs[0].delay);
        assert_memory_equal(after->columns, before->columns, sizeof before->columns);
        assert_memory_equal(&after->machine, &before->machine, sizeof before->machine);
        lg_test_give_back(mark);
    }
}

/* Kind, coordinate of the first feature, and widths or degree of each term: "damping diagonal, ...". */
static const char *terms_of(const lg_machine *machine) {
    char *out = TEST_ARRAY(char, 1000);
    for (uint32_t i = 0; i < machine->term_count; i++) {
        const lg_machine_term *term = &machine->terms[i];
        lg_append(out, 1000, "%s %s", lg_machine_part_name(term->part), lg_term_kind_name(term->kind));
        if (term->of_count > 0) lg_append(out, 1000, " %u", term->of[0].index);
        for (uint32_t k = 0; k < term->hidden_layers; k++) lg_append(out, 1000, " %u", term->hidden[k]);
        lg_append(out, 1000, ", ");
    }
    return out;
}

TEST("in random machine files a change adds its term behind those of its part, and changes nothing else") {
    static const struct {
        const char *change, *term;
        lg_machine_part part;
    } rows[] = {{"damping: cubic", "damping cubic, ", LG_MACHINE_DAMPING},
                {"damping: [{kind: cubic}]", "damping cubic, ", LG_MACHINE_DAMPING},
                {"potential: {kind: quadratic, of: x}", "potential quadratic 0, ", LG_MACHINE_POTENTIAL},
                {"residual: {kind: network, of: x}", "residual network 0 16 16, ", LG_MACHINE_RESIDUAL},
                {"offset: unknown", "offset unknown, ", LG_MACHINE_OFFSET}};
    lg_rng rng = test_rng(36, 1);
    for (int round = 0; round < 300; round++) {
        const size_t mark = lg_test_owned(), i = lg_rng_below(&rng, LG_COUNT(rows));
        const char *text = random_machine(&rng);
        lg_machine_file *before = machine_of(text), *after = machine_of(changed(text, rows[i].change));
        uint32_t at = 0;
        while (at < before->machine.term_count && before->machine.terms[at].part <= rows[i].part) at++;
        lg_machine first = before->machine;
        first.term_count = at;
        const char *old = terms_of(&before->machine), *begin = terms_of(&first);
        assert_string_equal(terms_of(&after->machine),
                            test_text("%s%s%s", begin, rows[i].term, old + strlen(begin)));
        assert_memory_equal(after->inputs, before->inputs, sizeof before->inputs);
        assert_memory_equal(after->columns, before->columns, sizeof before->columns);
        lg_test_give_back(mark);
    }
}

#define TWO                                                                                                  \
    "{coordinates: [{name: x, kind: line, velocity: vx}, {name: y, kind: line, velocity: vy}], "             \
    "inputs: {columns: [u, w], lag: [none, unknown], curve: {degree: 2}}, "

TEST("a change takes the place of what it gives anew") {
    static const struct {
        const char *text, *changes, *expected; /* without the terms before the potential */
    } rows[] = {
        {TWO "potential: [{kind: quadratic, of: x}, {kind: quadratic, of: y}]}",
         "potential: {kind: polynomial, of: y, degree: 3}",
         "potential quadratic 0, potential polynomial 1, input_map constant, actuator lag 1, actuator curve "
         "0, "},
        {TWO "potential: [{kind: quadratic, of: x}, {kind: linear, of: x}]}",
         "potential: {kind: polynomial, of: x, degree: 4}\n---\npotential: {kind: linear, of: y}",
         "potential polynomial 0, potential linear 0, potential linear 1, input_map constant, actuator lag "
         "1, actuator curve 0, "},
        {TWO "potential: [{kind: quadratic, of: [x, y]}, {kind: known, form: quadratic, of: x, values: 1}]}",
         "potential: {kind: polynomial, of: x, degree: 3}",
         "potential quadratic 0, potential quadratic 0, potential polynomial 0, input_map constant, actuator "
         "lag 1, actuator curve 0, "},
        {TWO "damping: diagonal}", "damping: asymmetric\noffset: unknown\n---\ndamping: cubic\n",
         "damping diagonal, damping asymmetric, damping cubic, input_map constant, offset unknown, actuator "
         "lag 1, actuator curve 0, "},
        {TWO "damping: none}", "inputs: {lag: {order: 2}}\n---\ninputs: {curve: none}",
         "input_map constant, actuator second_order_lag 0, "},
        {TWO "damping: {kind: network, of: x}, residual: {kind: network, of: y, hidden: 8}}",
         "hidden: [5, 3]",
         "damping network 0 5 3, input_map constant, residual network 1 5 3, actuator lag 1, actuator curve "
         "0, "}};
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        assert_string_equal(terms_of(&machine_of(changed(rows[i].text, rows[i].changes))->machine),
                            test_text("mass constant, %s", rows[i].expected));
}

TEST("a change of what a machine is, or that is not YAML, is refused with the line and the key") {
    static const struct {
        const char *changes, *words;
    } rows[] = {
        {"coordinates: []", "line 3: unknown key 'coordinates'; known: inputs, mass, "},
        {"inputs: {columns: [a]}", "line 3: unknown key 'inputs.columns'; known: hold, delay, lag, curve"},
        {"inputs: {hold: cubic}\n---\ndamping: cubc", "line 5: damping: kind 'cubc' is unknown"},
        {"inputs: {delay: 1}\n---\n- damping", "line 5: keys and values are expected"},
        {"hidden: 0", "line 3: hidden: "},
        {"", "line 4: keys and values are expected"},
        {"damping: [", "is not YAML"}};
    lg_machine_file *out = TEST_ARRAY(lg_machine_file, 1);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_error error = {LG_OK, ""};
        const char *text = changed(TWO "mass: diagonal}", rows[i].changes);
        assert_int_equal(lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), out, &error),
                         LG_FORMAT);
        assert_says(error.message, rows[i].words);
    }
}
