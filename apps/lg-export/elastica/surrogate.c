/* Surrogates of the elastica: the faces of their curve (code/surrogate), golden inputs, and the description
 * in NAME.h. */
#include <math.h>
#include <string.h>

#include "lg-export/faces.h"
#include "liegrad/elastica.h"
#include "liegrad/networks.h"

/* PLACES: arc lengths per golden vector at which q and v of the curve are compared. NUMBERS: number of
 * boundary conditions. */
enum { PLACES = 5, NUMBERS = 8 };

static const lg_surrogate_file *file_of(const export_model *m) {
    return lg_model_file_of(m->file, &lg_recipe_surrogate);
}

static bool is_beam(const export_model *m) {
    return file_of(m) != NULL;
}

static bool has_place(const lg_surrogate *model) {
    return model->options.kind != LG_SURROGATE_DISCRETE;
}

static const char *const boundary_names[NUMBERS] = {"q0x", "q0y", "v0x", "v0y", "qNx", "qNy", "vNx", "vNy"};

/* ---- code ---- */

static void curve_code(export_model *m) {
    export_source *source = m->source;
    const lg_surrogate *model = &file_of(m)->run.model;
    const lg_surrogate_kind kind = model->options.kind;
    const size_t n = model->intervals, panels = n * ((50 + n - 1) / n);
    /* Reals of work memory that the fragment needs besides its functions. */
    const size_t least[LG_SURROGATE_KIND_COUNT] = {[LG_SURROGATE_DISCRETE] = 8 * n, [LG_SURROGATE_ANGLE] = 8};
    char fragment[32];
    (void)snprintf(fragment, sizeof fragment, "curve_%s", lg_surrogate_kind_name(kind));
    if (kind != LG_SURROGATE_CONTINUOUS) {
        export_code(source, "curve_mark");
        export_real(source, &source->code, "LENGTH", model->length);
    }
    if (kind == LG_SURROGATE_DISCRETE) {
        export_constant(source, "INTERVALS", n);
        export_code(source, "curve_nodes");
    } else if (kind == LG_SURROGATE_ANGLE) {
        export_constant(source, "SYMMETRIC", model->options.symmetric);
        export_constant(source, "PANELS", panels);
        export_real(source, &source->code, "PANEL", model->length / (double)panels);
        export_real(source, &source->code, "PANEL_SLACK",
                    fmax(1e-9, 4 * export_eps(source->options) * (double)panels));
    }
    export_code(source, fragment);
    for (size_t i = 0; i < m->count; i++) {
        const size_t work = least[kind] + m->functions[i].work;
        if (strcmp(m->functions[i].function, "grad") != 0 && work > source->work) source->work = work;
    }
}

/* Number of dense layers applied one after another, plus the operations on the last layer's numbers. */
static size_t depth_of(const void *contents) {
    const lg_surrogate *model = &((const lg_surrogate_file *)contents)->run.model;
    const lg_net *net = &model->net;
    const size_t steps = net->kind == LG_NET_RESNET || net->kind == LG_NET_MULT_AFFINE ? 2 : 1;
    return (net->embedding > 0) + 1 + steps * net->layers + 1 + 1 + (model->options.modes > 0) +
           (model->options.angles ? 8 : 0);
}

/* ---- description in NAME.h ---- */

static void add_kind(text *to, const lg_surrogate *model) {
    static const char *const sentences[LG_SURROGATE_KIND_COUNT] = {
        "inner nodes and tangents of the beam's curve from its boundary conditions",
        "position on the beam's curve at arc length s, from its boundary conditions",
        "angle of the beam's tangent at arc length s, from its boundary conditions",
    };
    lg_text_add(to, "Surrogate of a planar clamped beam (elastica), %s network:\n%s.\n",
                lg_surrogate_kind_name(model->options.kind), sentences[model->options.kind]);
    lg_text_add(to,
                "Length of the beam L = %.12g, N = %u intervals between the nodes of the training data.\n\n",
                model->length, model->intervals);
}

static void add_inputs(text *to, const lg_surrogate *model) {
    const bool place = has_place(model);
    lg_text_add(to, "inputs x (%d):\n", NUMBERS + place);
    if (place) lg_text_add(to, "  %-24s  arc length from q0, 0 to L, unit of length of L\n", "s");
    lg_text_add(to,
                "  %-24s  start of the beam, unit of length of L; positions are relative to it\n  %-24s  "
                "unit tangent there, no unit\n  %-24s  end of the beam, unit of length of L\n  %-24s  unit "
                "tangent there\n",
                "q0x q0y", "v0x v0y", "qNx qNy", "vNx vNy");
    if (model->options.kind == LG_SURROGATE_DISCRETE)
        lg_text_add(
            to,
            "outputs y (%u): q_1x q_1y ... q_%ux q_%uy, unit of length, then v_1x v_1y ... v_%ux v_%uy,\n"
            "  unit tangents: node k at arc length k L/N. Gradient: d y/d x, one row an output.\n\n",
            4 * (model->intervals - 1), model->intervals - 1, model->intervals - 1, model->intervals - 1,
            model->intervals - 1);
    else if (model->options.kind == LG_SURROGATE_CONTINUOUS)
        lg_text_add(to,
                    "outputs y (2): q(s) = (qx, qy), unit of length. Gradient: d y/d x, one row an output;\n"
                    "  its first column is the tangent v(s) = dq/ds.\n\n");
    else
        lg_text_add(to,
                    "outputs y (1): theta(s) in radians, v(s) = (cos theta, sin theta). Gradient: d y/d x;\n"
                    "  its first number is the curvature, 1/unit of length.\n\n");
}

/* Adds the least and largest value of each boundary condition in the training data. */
static void add_range(text *to, const lg_surrogate_file *file) {
    if (file->trained_count == 0) return;
    lg_text_add(to, "Trained on %zu boundary conditions; outside their range the curve is meaningless:\n",
                file->trained_count);
    for (size_t c = 0; c < NUMBERS; c++) {
        double least = INFINITY, largest = -INFINITY;
        for (size_t i = 0; i < file->trained_count; i++) {
            least = fmin(least, file->trained[NUMBERS * i + c]);
            largest = fmax(largest, file->trained[NUMBERS * i + c]);
        }
        lg_text_add(to, "  %-4s  %.6g to %.6g\n", boundary_names[c], least, largest);
    }
    if (file->run.model.options.mirror) lg_text_add(to, "  or their mirror images (all y -> -y)\n");
    lg_text_add(
        to,
        "  Distance of (qN - q0, v0, vN) from the nearest trained ones: at most about %.3g, from the lines\n"
        "  through neighbours %.3g; the largest |qN - q0| is the unit of length.\n\n",
        2 * lg_surrogate_reach(file->trained, file->trained_count),
        2 * lg_surrogate_spread(file->trained, file->trained_count));
}

static void tell(export_model *m) {
    const lg_surrogate_file *file = m->file->contents;
    export_source *source = m->source;
    static const char *const how[LG_SURROGATE_KIND_COUNT] = {
        " * Between nodes: the cubic through them with their tangents, and its derivative; an s beyond an "
        "end is\n"
        " * that end. That tangent is a difference of nodes over L/N: its rounding is N/L times that of q. "
        "*/\n",
        " * q is the network's value and v its derivative: one evaluation a point. */\n",
        " * v from the angle; q is q0 and the integral of v by Gauss's rule of 3 points on panels, whole "
        "ones\n"
        " * from 0, then a part. Panels are summed with compensation: the tolerance is that of the angles,\n"
        " * however many there are. v alone costs one evaluation a point, q 3 for each panel up to the last "
        "s. */\n",
    };
    const lg_surrogate *model = &file->run.model;
    text *to = &source->about;
    add_kind(to, model);
    add_inputs(to, model);
    add_range(to, file);
    lg_text_add(
        &source->declarations,
        "/* The curve of boundary conditions x (8: q0 v0 qN vN) at s (points), rising, 0 to L: q and v "
        "(points,\n"
        " * 2), either of which may be NULL.\n%s",
        how[model->options.kind]);
    lg_text_add_named(
        &source->declarations, source->options->name,
        "void NAME_curve(const NAME_real *x, const NAME_real *s, int points, NAME_real *q, NAME_real *v,\n"
        "    NAME_real *work);\n");
}

/* ---- golden vectors ---- */

/* Draws boundary conditions near trained ones. If none are known, draws any two tangents and a gap between
 * 0.3 L and L. Models with the option `mirror` get either side of the mirror; every other vector is
 * shifted. */
static void draw_boundary(const lg_surrogate_file *file, lg_rng *rng, size_t i, double *x) {
    const double length = file->run.model.length;
    if (file->trained_count > 0) {
        const double *trained = file->trained + NUMBERS * (size_t)lg_rng_below(rng, file->trained_count);
        for (size_t c = 0; c < NUMBERS; c++) x[c] = trained[c] + lg_rng_uniform_in(rng, -1e-2, 1e-2);
    } else {
        const double gap = length * lg_rng_uniform_in(rng, 0.3, 1), turn = lg_rng_uniform_in(rng, -1, 1);
        const double first = lg_rng_uniform_in(rng, -2, 2), last = lg_rng_uniform_in(rng, -2, 2);
        const double made[NUMBERS] = {
            0, 0, cos(first), sin(first), gap * cos(turn), gap * sin(turn), cos(last), sin(last)};
        memcpy(x, made, sizeof made);
    }
    const double sign = file->run.model.options.mirror && lg_rng_below(rng, 2) == 1 ? -1 : 1;
    const double shift[2] = {length * lg_rng_uniform_in(rng, -1, 1), length * lg_rng_uniform_in(rng, -1, 1)};
    for (size_t c = 0; c < NUMBERS; c++) {
        if (c % 2 == 1) x[c] *= sign;
        if (i % 2 == 1 && c % 4 < 2) x[c] += shift[c % 2];
    }
}

static void draw(export_model *m, double *x, size_t v) {
    const lg_surrogate_file *file = m->file->contents;
    const bool place = has_place(&file->run.model);
    if (place) x[0] = file->run.model.length * lg_rng_uniform(&m->rng);
    draw_boundary(file, &m->rng, v, x + place);
}

/* Returns the factor by which tangents of the curve are multiplied before they are compared. The discrete
 * network's tangents are differences of nodes divided by L/N, so their rounding errors are the nodes' divided
 * by L/N. */
static double tangent_scale(const export_source *source, const lg_surrogate *model) {
    const double interval = model->length / model->intervals;
    return model->options.kind == LG_SURROGATE_DISCRETE && interval < 1
               ? export_round(source->options, interval)
               : 1;
}

static void write_places(export_source *source, const double *places, bool place, double scale) {
    text *to = &source->test;
    export_reals(source, to, "curve_places", places, PLACES);
    export_real(source, to, "tangent_scale", scale);
    lg_text_add(to, "enum { CURVE_PLACES = %d, BOUNDARY_AT = %d };\n", PLACES, place);
    export_test_code(source, "test_surrogate");
}

/* Compares the curve at both ends, at a node, and within the first and the last interval. */
static lg_status curve_golden(export_model *m) {
    export_source *source = m->source;
    const lg_surrogate *model = &file_of(m)->run.model;
    const double length = model->length, interval = length / model->intervals;
    const double share[PLACES] = {0, 0.3 * interval, floor(0.5 * model->intervals) * interval,
                                  (model->intervals - 0.7) * interval, length};
    const double scale = tangent_scale(source, model);
    const bool place = has_place(model);
    double places[PLACES];
    lg_surrogate_curves *curves = NULL;
    LG_TRY(lg_surrogate_curves_create(m->self->context, model, file_of(m)->theta, LG_F64, PLACES, &curves,
                                      NULL));
    APP_FREE void *work = app_alloc(lg_surrogate_curves_work_size(curves), 1);
    for (size_t i = 0; i < PLACES; i++) places[i] = export_round(source->options, share[i]);
    write_places(source, places, place, scale);
    double *q = export_golden_further(source, 4 * (size_t)PLACES, "curve");
    for (size_t i = 0; i < source->golden.count; i++, q += 4 * (size_t)PLACES) {
        double *v = q + 2 * PLACES;
        lg_surrogate_curve(curves, source->golden.x + source->inputs * i + place, places, PLACES, q, v, work);
        for (size_t k = 0; k < 2 * PLACES; k++) v[k] *= scale;
    }
    lg_surrogate_curves_destroy(curves);
    return LG_OK;
}

/* ---- rows of the faces ---- */

static bool has_nodes(const export_model *m) {
    return is_beam(m) && !has_place(&file_of(m)->run.model);
}

#define CURVE(its_fits, ...)                                                                                 \
    {                                                                                                        \
        .functions = {__VA_ARGS__}, .fits = its_fits, .code = curve_code, .golden = curve_golden,            \
        .stack = 2048, .calls = 6                                                                            \
    }
const export_face export_face_points = CURVE(is_beam, {"point", "point", false}, {"place", "place", false});
const export_face export_face_angle =
    CURVE(is_beam, {"ends", "ends", false}, {"point", "point", false}, {"span", "span", true});
const export_face export_face_nodes = CURVE(has_nodes, {"value", "eval", false});

const export_kind export_kind_surrogate = {
    .recipe = &lg_recipe_surrogate, .stream = 0x676f6c64, .draw = draw, .depth = depth_of, .tell = tell};
