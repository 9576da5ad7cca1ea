#version 460
// From the composited colours of a group's rays to their loss and back: sky, exposure, transients, the display-encoded
// error, and the same backward. A thread does a ray's colour; in the effects' networks eight threads share a ray. What
// the later passes need for the gradients of the effects' parameters is kept.
#extension GL_GOOGLE_include_directive : require
#include "step.glsl"
#include "effects.glsl"
#include "sky.glsl"
layout(local_size_x = 32, local_size_y = 8) in;
layout(std430, binding = 1) readonly buffer Target { vec4 target[]; };
layout(std430, binding = 2) readonly buffer Counts { uint n_panels, kept_rays; };
layout(std430, binding = 3) readonly buffer GroupPanel { uvec2 group_panel[]; };
layout(std430, binding = 4) readonly buffer GroupSamples { uint group_samples[]; };
layout(std430, binding = 5) readonly buffer Pixel { vec4 pixel[]; };
layout(std430, binding = 6) readonly buffer Values { float value[]; };
layout(std430, binding = 7) readonly buffer Constants { float constant[]; };
layout(std430, binding = 8) readonly buffer Rays { float ray[]; };
layout(std430, binding = 9) readonly buffer RayPhoto { uint ray_photo[]; };
layout(std430, binding = 10) readonly buffer RayUv { vec2 ray_uv[]; };
layout(std430, binding = 11) readonly buffer SkyHint { uint sky_hint[]; };
layout(std430, binding = 12) writeonly buffer DPixel { vec4 d_pixel[]; };
layout(std430, binding = 13) buffer KeptX { float kept_x[]; }; // [group][ROWS_X][ray]
layout(std430, binding = 14) writeonly buffer KeptD { float kept_d[]; }; // [group][ROWS_D][ray]
layout(std430, binding = 15) writeonly buffer GroupSums { float group_sums[]; };

const uint PARTS = 8, WIDEST = 64;
shared float x[WIDEST * GROUP]; // [row][ray] what goes into a layer, or comes out of it
shared float sorted[GROUP], quartile;
shared vec4 sum_of[GROUP]; // error, weighed error, weight, rays
shared vec4 shown[GROUP];  // the photo's colour, display-encoded, and 1 where it is finite
shared uint bad_of[GROUP];
uint g, i, part, r; // group of rays, place in it, part of the work for this ray, ray

// ---- networks ----

void keep_x(uint row, float v)
{
    kept_x[(g * ROWS_X + row) * GROUP + i] = v;
}
void keep_d(uint row, float v)
{
    kept_d[(g * ROWS_D + row) * GROUP + i] = v;
}
void put(uint row, float v)
{
    x[row * GROUP + i] = v;
}

// Row k of a network's input.
void enter(Head h, uint k, float v)
{
    put(k, v);
    keep_x(h.x + k, v);
}

// Layer l; its output replaces its input.
void forward(Head h, uint l)
{
    uint offset, rows, columns;
    float y[WIDEST / PARTS];
    layer_of(h, l, offset, rows, columns);
    for (uint j = 0; j < WIDEST / PARTS; j++)
        y[j] = 0;
    barrier();
    for (uint k = 0; k < columns; k++) {
        const float v = x[k * GROUP + i];
        for (uint j = 0; j < WIDEST / PARTS; j++) {
            const uint o = part + PARTS * j;
            if (o < rows) y[j] += value[h.at + offset + o * columns + k] * v;
        }
    }
    barrier();
    for (uint j = 0; j < WIDEST / PARTS; j++) {
        const uint o = part + PARTS * j;
        if (o >= rows) break;
        put(o, l < 2 ? max(y[j], 0) : y[j]);
        if (l < 2) keep_x(h.x + h.n_in + l * h.width + o, max(y[j], 0));
    }
    barrier();
}

// Layer l backward; the gradients of its input replace those of its output. No gradient passes where the activation of
// the forward pass is 0.
void backward(Head h, uint l)
{
    uint offset, rows, columns;
    float d[WIDEST / PARTS];
    layer_of(h, l, offset, rows, columns);
    for (uint j = 0; j < WIDEST / PARTS; j++)
        d[j] = 0;
    barrier();
    for (uint o = 0; o < rows; o++) {
        const float v = x[o * GROUP + i];
        for (uint j = 0; j < WIDEST / PARTS; j++) {
            const uint k = part + PARTS * j;
            if (k < columns) d[j] += value[h.at + offset + o * columns + k] * v;
        }
    }
    barrier();
    for (uint j = 0; j < WIDEST / PARTS; j++) {
        const uint k = part + PARTS * j;
        if (k >= columns) break;
        const bool passes = l == 0 || kept_x[(g * ROWS_X + h.x + h.n_in + (l - 1) * h.width + k) * GROUP + i] > 0;
        put(k, passes ? d[j] : 0);
        if (l > 0) keep_d(h.d + (l - 1) * h.width + k, passes ? d[j] : 0);
    }
    barrier();
}

void run(Head h)
{
    for (uint l = 0; l < 3; l++)
        forward(h, l);
}

// From the gradients of the output, of which each thread has row `part`, to those of the input, which are left in x.
void run_back(Head h, float d_out)
{
    barrier();
    if (part < h.n_out) {
        put(part, d_out);
        keep_d(h.d + 2 * h.width + part, d_out);
    }
    for (uint l = 3; l-- > 0;)
        backward(h, l);
}

// ---- the sky (src/effect/sky.c) ----

const float MATTER = 0.012, GAP = 0.03, SHOWN = 0.15, HORIZON = 0.05, SKY_PRIOR = 2e-5;
vec3 sky_light;
float sky_open;

void add_sky(inout vec3 rgb, float after)
{
    const Head h = head_of(0);
    const vec3 dir = RAY_WORLD(r);
    const uint code = s.at_sky + ray_photo[r] * SKY_CODE;
    float basis[16];
    harmonics_of(dir, basis);
    for (uint k = 0; k < 16; k++)
        if (k % PARTS == part) enter(h, k, sky_of_degree(k) * basis[k]);
    run(h);
    for (uint c = 0; c < 3; c++) {
        float slope = 0;
        for (uint k = 0; k < 3; k++)
            slope += value[code + 3 + 3 * k + c] * dir[k];
        sky_light[c] = light(x[c * GROUP + i] + value[code + c] + SKY_SLOPE * slope);
    }
    sky_open = sky_cover(dir);
    rgb += after * sky_open * sky_light;
}

uint hint_of_ray() // 1: none; 2: shown; 3: none, late; 4: none, at last
{
    return s.has_hints != 0 ? sky_hint[r >> 2] >> 8 * (r & 3) & 255 : 0;
}

// Gradient of the sky's own loss, with respect to the transmittance.
float sky_loss(float scale)
{
    const uint hint = hint_of_ray();
    const float matter = hint == 2 ? SHOWN : hint == 0 && RAY_Z(r) > HORIZON ? MATTER : 0;
    return scale * ((hint == 1 ? GAP : 0) - matter);
}

void sky_back(vec3 d, float after, float scale, inout float d_after)
{
    const vec3 dir = RAY_WORLD(r);
    const bool tells = hint_of_ray() != 1 && hint_of_ray() != 3;
    vec3 d_logit;
    for (uint c = 0; c < 3; c++) {
        d_logit[c] = tells ? d[c] * after * sky_open * light_gradient(sky_light[c]) : 0;
        d_after += d[c] * sky_open * sky_light[c];
    }
    const uint code = s.at_sky + ray_photo[r] * SKY_CODE;
    for (uint k = 0; k < SKY_CODE && part == 0; k++) {
        const float along = k < 3 ? 1 : SKY_SLOPE * dir[k / 3 - 1];
        keep_d(D_SKY_CODE + k, d_logit[k % 3] * along + scale * SKY_PRIOR * value[code + k]);
    }
    run_back(head_of(0), part < 3 ? d_logit[part] : 0);
}

// ---- exposure (src/effect/exposure.c) ----

const float EXPOSURE_PRIOR = 2e-4;

vec2 exposure_of()
{
    const uint at = s.constants_exposure + 2 * ray_photo[r];
    return vec2(constant[at], constant[at + 1]); // what is known, and 1 where the rest is learned
}
float gain_of()
{
    const vec2 known = exposure_of();
    return exp2(known.x + known.y * value[s.at_exposure + ray_photo[r]]);
}

// ---- transients (src/effect/transient.c) ----

const float BRIGHTEST = 1.2, SIGMA_BIAS = -2, LEAST_RAW = -6, BETA_MIN = 0.1, UNSURE = 0.3, VEIL = 0.1;
float raw_sigma, raw_unsure, alpha, beta;
vec3 own, before; // colours of the layer, and before it

float logistic(float v)
{
    return 1 / (1 + exp(-v));
}
// log(1 + v) for v >= 0. It stays exact for a small v, which 1 + v would round away.
float log1p(float v)
{
    return v < 1e-3 ? v - 0.5 * v * v : log(1 + v);
}

void add_transient(inout vec3 rgb)
{
    const Head h = head_of(1);
    const vec2 uv = ray_uv[r];
    barrier();
    for (uint k = part; k < TRANSIENT_CODE; k += PARTS)
        enter(h, k, value[s.at_transient + ray_photo[r] * TRANSIENT_CODE + k]);
    if (part < 6) {
        const float phase = 1.5707963 * float(1 << part / 2) * uv[part % 2];
        enter(h, TRANSIENT_CODE + 2 * part, sin(phase));
        enter(h, TRANSIENT_CODE + 2 * part + 1, cos(phase));
    }
    if (part < LEVELS) {
        uint at[4];
        float weight[4];
        nodes_of(uv, ray_photo[r], part, at, weight);
        vec2 feature = vec2(0);
        for (uint k = 0; k < 4; k++)
            feature += weight[k] * vec2(value[h.at + at[k]], value[h.at + at[k] + 1]);
        enter(h, TRANSIENT_CODE + 12 + FEATURES * part, feature.x);
        enter(h, TRANSIENT_CODE + 12 + FEATURES * part + 1, feature.y);
    }
    run(h);
    raw_sigma = x[i] + SIGMA_BIAS;
    alpha = 1 - exp(-(raw_sigma > 15 ? raw_sigma : log1p(exp(raw_sigma))));
    for (uint c = 0; c < 3; c++)
        own[c] = BRIGHTEST * logistic(x[(1 + c) * GROUP + i]);
    raw_unsure = x[4 * GROUP + i];
    beta = BETA_MIN + alpha * UNSURE * logistic(raw_unsure);
    before = rgb;
    rgb += alpha * (own - rgb);
}

// The third quartile of these rays' errors, which are negative where they do not count.
float quartile_of(float error)
{
    if (part == 0) sorted[i] = error;
    if (part == 0 && i == 0) quartile = 0;
    barrier();
    uint n = 0, rank = 0;
    for (uint k = 0; k < GROUP; k++) {
        n += sorted[k] >= 0 ? 1 : 0;
        rank += sorted[k] >= 0 && (sorted[k] < error || (sorted[k] == error && k < i)) ? 1 : 0;
    }
    if (part == 0 && error >= 0 && rank == n * 3 / 4) quartile = error;
    barrier();
    const float found = quartile;
    barrier(); // before the next call sets it again
    return found;
}

void transient_back(inout vec3 d, float d_beta, float d_cost)
{
    const Head h = head_of(1);
    const float unsure = UNSURE * logistic(raw_unsure);
    float d_out[8] = { 0, 0, 0, 0, 0, 0, 0, 0 }, d_alpha = d_beta * unsure;
    for (uint c = 0; c < 3; c++) {
        d_alpha += d[c] * (own[c] - before[c]);
        d_out[1 + c] = d[c] * alpha * own[c] * (1 - own[c] / BRIGHTEST);
    }
    d *= 1 - alpha;
    const float d_sigma = d_alpha * (1 - alpha) + d_cost;
    d_out[0] = raw_sigma < LEAST_RAW && d_sigma > 0 ? 0 : d_sigma * logistic(max(raw_sigma, LEAST_RAW));
    d_out[4] = d_beta * alpha * unsure * (1 - logistic(raw_unsure));
    run_back(h, d_out[part]);
    for (uint k = part; k < TRANSIENT_CODE; k += PARTS)
        keep_d(D_TRANSIENT_CODE + k, x[k * GROUP + i]);
    keep_d(D_FEATURE + part, x[(TRANSIENT_CODE + 12 + part) * GROUP + i]); // 8 threads, 8 features
}

// ---- the error ----

const float CLIPPED = 0.98;
float encode(float linear, out float gradient)
{
    gradient = 12.92;
    if (linear <= 0.0031308) return 12.92 * linear;
    const float power = pow(linear, 1 / 2.4);
    gradient = 1.055 / 2.4 * power / linear;
    return 1.055 * power - 0.055;
}

bool finite(float v)
{
    return !isnan(v) && !isinf(v);
}

const float LEAST_QUARTILE = 1e-4; // as in src/train/shade.c

float error_of(vec3 rgb, vec3 wanted, float scale, out vec3 d)
{
    float error = 0;
    d = vec3(0);
    for (uint k = 0; k < 3; k++) {
        const vec3 row = vec3(s.srgb[3 * k], s.srgb[3 * k + 1], s.srgb[3 * k + 2]);
        const float a = dot(row, rgb), b = dot(row, wanted);
        float gradient, unused;
        if (b >= CLIPPED && a >= b) continue;
        const float e = encode(a, gradient) - encode(b, unused);
        error += e * e;
        d += 2 * scale * e * gradient * row;
    }
    return error;
}

// A photo's colour as a display shows it; 0 where the ray does not count.
vec4 shown_of(vec4 wanted)
{
    vec4 shows = vec4(0);
    float unused;
    if (!(wanted.w > 0) || !finite(wanted.x + wanted.y + wanted.z)) return shows;
    for (uint k = 0; k < 3; k++)
        shows[k] = encode(dot(vec3(s.srgb[3 * k], s.srgb[3 * k + 1], s.srgb[3 * k + 2]), wanted.xyz), unused);
    shows.w = 1;
    return shows;
}

// The sums of a group, by one thread in the order of the rays.
void write_sums()
{
    vec4 sum = vec4(0), colour = vec4(0);
    vec3 squared = vec3(0);
    uint bad = 0;
    for (uint k = 0; k < GROUP; k++) {
        sum += sum_of[k];
        bad += bad_of[k];
        colour += shown[k];
        squared += shown[k].xyz * shown[k].xyz;
    }
    for (uint k = 0; k < 4; k++)
        group_sums[g * SUM_KINDS + k] = sum[k];
    group_sums[g * SUM_KINDS + 5] = float(bad);
    for (uint k = 0; k < 3; k++) {
        group_sums[g * SUM_KINDS + 8 + k] = colour[k];
        group_sums[g * SUM_KINDS + 11 + k] = squared[k];
    }
    group_sums[g * SUM_KINDS + 14] = colour.w;
}

void main()
{
    g = gl_WorkGroupID.x;
    i = gl_LocalInvocationID.x;
    part = gl_LocalInvocationID.y;
    r = g * GROUP + i;
    if (group_panel[g].x == NONE || (group_samples[g] == 0 && s.background == 0)) { // all threads of the group
        if (part == 0) d_pixel[r] = vec4(0);
        if (part == 0 && i < SUM_KINDS) group_sums[g * SUM_KINDS + i] = 0;
        return;
    }
    const float after = pixel[r].w, gain = is_on(EXPOSURE) ? gain_of() : 1;
    const vec4 wanted = target[r];
    vec3 rgb = pixel[r].xyz, d, unused;
    if (is_on(SKY)) add_sky(rgb, after);
    if (is_on(EXPOSURE)) rgb *= gain;
    const vec3 exposed = rgb;
    if (is_on(TRANSIENT)) add_transient(rgb);

    const float scale_all = 1.0 / (3.0 * float(max(kept_rays, 1)));
    float error = error_of(rgb, wanted.xyz, scale_all * wanted.w, d), factor = 1, d_beta = 0, d_cost = 0, d_after = 0;
    const bool counts = wanted.w > 0, good = counts && finite(error) && finite(d.x + d.y + d.z);
    const float scale = good ? scale_all * wanted.w : 0;
    error = good ? error : 0;
    d = good ? d : vec3(0);
    if (is_on(SKY)) d_after = sky_loss(scale);
    if (is_on(TRANSIENT)) {
        const float without = error_of(before, wanted.xyz, 0, unused);
        const float asked = max(2 * BETA_MIN * BETA_MIN, quartile_of(scale > 0 && finite(without) ? without : -1));
        factor = BETA_MIN * BETA_MIN / (beta * beta);
        d_beta = scale * (asked - 2 * error * factor) / beta;
        const float veil = alpha + VEIL;
        d_cost = scale * asked * (1 + VEIL) * VEIL / (veil * veil) * (1 - alpha);
        d *= factor;
    }
    // Large errors count less: see train/shade.c.
    d /= sqrt(1 + error / max(quartile_of(scale > 0 ? error : -1), LEAST_QUARTILE));
    if (part == 0) {
        sum_of[i] = good ? vec4(error, factor * error, factor, 1) : vec4(0);
        bad_of[i] = counts && !good ? 1 : 0;
        shown[i] = shown_of(wanted);
    }
    barrier();
    if (part == 0 && i == 0) write_sums();

    if (is_on(TRANSIENT)) transient_back(d, d_beta, d_cost);
    if (is_on(EXPOSURE)) {
        const float cost = scale * EXPOSURE_PRIOR * value[s.at_exposure + ray_photo[r]];
        if (part == 0) keep_d(D_GAIN, exposure_of().y * 0.69314718 * dot(d, exposed) + cost);
        d *= gain;
    }
    if (is_on(SKY)) sky_back(d, after, scale, d_after);
    if (part == 0) d_pixel[r] = vec4(d, d_after);
}
