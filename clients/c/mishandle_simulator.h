/* Serves a simulator in C to Mishandle: docs/guide/simulator_clients.md. C99, no dependency, no heap.
 *
 * Fill a `struct mishandle_simulator`, write `simulate`, or `reset` and `step`, and return
 * `mishandle_serve(&simulator)` from `main`. Include this file in one source file. tank.c and cart.c beside it are
 * complete programs. Everything that the simulator prints to standard output goes to standard error.
 */
#ifndef MISHANDLE_SIMULATOR_H
#define MISHANDLE_SIMULATOR_H

#include <errno.h>
#include <locale.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#if defined(__unix__) || defined(__APPLE__)
#include <unistd.h>
#define MISHANDLE_HAS_DESCRIPTORS
#endif

/* Sizes of the buffers, which are static. Define larger ones before you include this file. */
#ifndef MISHANDLE_MOST_NAMES
#define MISHANDLE_MOST_NAMES 64 /* axes, signals, formulas, parts of observation and action: of each */
#endif
#ifndef MISHANDLE_MOST_NUMBERS
#define MISHANDLE_MOST_NUMBERS 1024 /* numbers of an observation or an action */
#endif
#ifndef MISHANDLE_MOST_SAMPLES
#define MISHANDLE_MOST_SAMPLES 65536 /* numbers of a trace: samples times signals */
#endif
#ifndef MISHANDLE_LONGEST_LINE
#define MISHANDLE_LONGEST_LINE 65536 /* bytes of a question */
#endif

/* ---- What the simulator states ---- */

struct mishandle_axis {
    const char *name, *unit;
    double low, high, nominal; /* of categories: only nominal, the number of one of them, from 0 */
    const char *kind;          /* "start", "model" (default), "event", "fault", "input" */
    const char *values;        /* NULL, "integer", "logarithmic", or categories: "cold|warm" */
};

struct mishandle_quantity {
    const char *name, *unit;
    size_t size; /* of parts of an observation or an action: how many numbers, 0 is 1 */
};

struct mishandle_formula {
    const char *name, *text;
};

struct mishandle_question;

/* A list ends at the first entry without a name. */
struct mishandle_simulator {
    const char *name, *version;
    double control_dt; /* s */
    size_t steps;      /* control steps of an episode; a trace has steps + 1 samples */
    struct mishandle_axis axes[MISHANDLE_MOST_NAMES];
    struct mishandle_quantity signals[MISHANDLE_MOST_NAMES];
    struct mishandle_formula formulas[MISHANDLE_MOST_NAMES];
    struct mishandle_quantity observation[MISHANDLE_MOST_NAMES]; /* both for a policy of Mishandle */
    struct mishandle_quantity action[MISHANDLE_MOST_NAMES];
    double action_limit;                            /* the actions of the policy are within plus and minus this */
    int is_seeded;                                  /* answers depend on the seed */
    int is_random;                                  /* equal questions may have different answers */
    const char *more;                               /* further keys of hello as JSON, such as "\"files\":[\"a.c\"]" */
    void (*simulate)(struct mishandle_question *);  /* a whole episode: steps + 1 calls of mishandle_sample */
    void (*reset)(struct mishandle_question *);     /* one call of mishandle_sample, for time 0 */
    void (*step)(struct mishandle_question *);      /* one control step: one call of mishandle_sample */
};

enum mishandle_ending {
    MISHANDLE_COMPLETE,
    MISHANDLE_TERMINATED, /* the episode ended early */
    MISHANDLE_DIVERGED,   /* the numbers from here on have no meaning */
    MISHANDLE_INVALID     /* the scenario cannot start */
};

struct mishandle_question {
    const struct mishandle_simulator *simulator;
    uint64_t id, seed;
    double action[MISHANDLE_MOST_NUMBERS];
    /* The rest belongs to the functions below. */
    char type[16];
    double scenario[MISHANDLE_MOST_NAMES]; /* in the order of the axes */
    int is_given[MISHANDLE_MOST_NAMES];
    size_t action_count, samples;
    double trace[MISHANDLE_MOST_SAMPLES];
    double observation[MISHANDLE_MOST_NUMBERS];
    int is_observed;
    enum mishandle_ending ending;
    char reason[256], error[256];
};

/* ---- What `simulate`, `reset` and `step` call ---- */

/* Answers the question with an error, the text `what` followed by `name`. The first one counts. */
static inline void mishandle_fail(struct mishandle_question *question, const char *what, const char *name) {
    if (question->error[0] == '\0')
        snprintf(question->error, sizeof question->error, "%.180s%.60s", what, name);
}

/* Returns the value of an axis; of an axis of categories, its number, from 0. */
static inline double mishandle_value(struct mishandle_question *question, const char *axis) {
    for (size_t i = 0; i < MISHANDLE_MOST_NAMES && question->simulator->axes[i].name; i++)
        if (strcmp(question->simulator->axes[i].name, axis) == 0) return question->scenario[i];
    mishandle_fail(question, "the simulator states no axis ", axis);
    return NAN;
}

static inline size_t mishandle_count(const struct mishandle_quantity *list) {
    size_t count = 0;
    while (count < MISHANDLE_MOST_NAMES && list[count].name) count++;
    return count;
}

static inline size_t mishandle_numbers(const struct mishandle_quantity *list) {
    size_t sum = 0;
    for (size_t i = 0; i < MISHANDLE_MOST_NAMES && list[i].name; i++) sum += list[i].size ? list[i].size : 1;
    return sum;
}

/* Records the signals at one time, one number for each. */
static inline void mishandle_sample(struct mishandle_question *question, const double *signals) {
    size_t most = question->simulator->simulate ? question->simulator->steps + 1 : 1;
    size_t count = mishandle_count(question->simulator->signals);
    if (question->samples >= most || (question->samples + 1) * count > MISHANDLE_MOST_SAMPLES) {
        mishandle_fail(question, "more samples than ", question->simulator->simulate ? "steps + 1" : "one");
        return;
    }
    memcpy(question->trace + question->samples * count, signals, count * sizeof *signals);
    question->samples++;
}

/* Sets the observation of `reset` or `step`: the numbers of all its parts. */
static inline void mishandle_observe(struct mishandle_question *question, const double *observation) {
    size_t count = mishandle_numbers(question->simulator->observation);
    if (count > MISHANDLE_MOST_NUMBERS) return; /* `mishandle_serve` has refused it */
    memcpy(question->observation, observation, count * sizeof *observation);
    question->is_observed = 1;
}

/* Ends the episode; the reason may be NULL. */
static inline void mishandle_end(struct mishandle_question *question, enum mishandle_ending ending, const char *reason) {
    question->ending = ending;
    snprintf(question->reason, sizeof question->reason, "%.240s", reason ? reason : "");
}

/* ---- Reading a question ---- */

struct mishandle_text {
    const char *at, *end;
};

static inline void mishandle_skip_space(struct mishandle_text *text) {
    while (text->at < text->end && (*text->at == ' ' || *text->at == '\t' || *text->at == '\r')) text->at++;
}

/* Skips spaces and then one expected character. */
static inline int mishandle_accept(struct mishandle_text *text, char expected) {
    mishandle_skip_space(text);
    if (text->at >= text->end || *text->at != expected) return 0;
    text->at++;
    return 1;
}

static inline int mishandle_read_word(struct mishandle_text *text, const char *word) {
    size_t length = strlen(word);
    mishandle_skip_space(text);
    if ((size_t)(text->end - text->at) < length || memcmp(text->at, word, length) != 0) return 0;
    text->at += length;
    return 1;
}

static inline int mishandle_read_hex(struct mishandle_text *text, unsigned *code) {
    *code = 0;
    if (text->end - text->at < 4) return 0;
    for (int i = 0; i < 4; i++) {
        char c = *text->at++;
        unsigned digit = c >= '0' && c <= '9'   ? (unsigned)(c - '0')
                         : c >= 'a' && c <= 'f' ? (unsigned)(c - 'a' + 10)
                         : c >= 'A' && c <= 'F' ? (unsigned)(c - 'A' + 10)
                                                : 16u;
        if (digit == 16) return 0;
        *code = *code * 16 + digit;
    }
    return 1;
}

/* Writes a code point as UTF-8 and returns its number of bytes. */
static inline size_t mishandle_utf8(unsigned code, char *out) {
    static const unsigned leads[] = {0, 0xC0, 0xE0, 0xF0};
    size_t rest = code < 0x80 ? 0 : code < 0x800 ? 1 : code < 0x10000 ? 2 : 3;
    for (size_t i = rest; i > 0; i--, code >>= 6) out[i] = (char)(0x80 | (code & 0x3F));
    out[0] = (char)(leads[rest] | code);
    return rest + 1;
}

/* Reads a string. One that does not fit becomes empty, which is no name. */
static inline int mishandle_read_string(struct mishandle_text *text, char *out, size_t size) {
    size_t length = 0;
    out[0] = '\0';
    if (!mishandle_accept(text, '"')) return 0;
    while (text->at < text->end && *text->at != '"') {
        char bytes[4];
        size_t count = 1;
        bytes[0] = *text->at++;
        if ((unsigned char)bytes[0] < 0x20) return 0;
        if (bytes[0] == '\\') {
            static const char escapes[] = "\"\\/bfnrt", meanings[] = "\"\\/\b\f\n\r\t";
            if (text->at >= text->end) return 0;
            char escape = *text->at++;
            const char *found = escape ? strchr(escapes, escape) : NULL;
            if (found) {
                bytes[0] = meanings[found - escapes];
            } else {
                unsigned code, low;
                if (escape != 'u' || !mishandle_read_hex(text, &code)) return 0;
                if (code >= 0xD800 && code < 0xDC00) {
                    if (!mishandle_read_word(text, "\\u") || !mishandle_read_hex(text, &low)) return 0;
                    if (low < 0xDC00 || low > 0xDFFF) return 0;
                    code = 0x10000 + ((code - 0xD800) << 10) + (low - 0xDC00);
                } else if (code == 0 || (code >= 0xDC00 && code < 0xE000)) {
                    return 0;
                }
                count = mishandle_utf8(code, bytes);
            }
        }
        if (length + count < size) memcpy(out + length, bytes, count);
        length += count;
    }
    out[length < size ? length : 0] = '\0';
    return mishandle_accept(text, '"');
}

/* Reads a finite number. `strtod` alone would take hexadecimal numbers, names and the decimal comma of a locale. */
static inline int mishandle_read_number(struct mishandle_text *text, double *number) {
    mishandle_skip_space(text);
    const char *at = text->at;
    if (at >= text->end || !(*at == '-' || (*at >= '0' && *at <= '9'))) return 0;
    while (at < text->end && *at && strchr("0123456789+-.eE", *at)) at++;
    char *end;
    *number = strtod(text->at, &end); /* the line ends with a zero byte */
    if (end != at || !isfinite(*number)) return 0;
    text->at = at;
    return 1;
}

/* Skips a value of a key that this protocol version does not know. */
static inline int mishandle_skip_value(struct mishandle_text *text, int depth) {
    double number;
    char string[1];
    mishandle_skip_space(text);
    if (depth > 32 || text->at >= text->end) return 0;
    if (*text->at == '"') return mishandle_read_string(text, string, sizeof string);
    if (*text->at != '{' && *text->at != '[')
        return mishandle_read_word(text, "null") || mishandle_read_word(text, "true") ||
               mishandle_read_word(text, "false") || mishandle_read_number(text, &number);
    int is_object = *text->at == '{';
    char close = is_object ? '}' : ']';
    text->at++;
    if (mishandle_accept(text, close)) return 1;
    do {
        if (is_object && !(mishandle_read_string(text, string, sizeof string) && mishandle_accept(text, ':'))) return 0;
        if (!mishandle_skip_value(text, depth + 1)) return 0;
    } while (mishandle_accept(text, ','));
    return mishandle_accept(text, close);
}

/* Returns the number of a category in a list such as "cold|warm", or -1. */
static inline double mishandle_category(const char *values, const char *name) {
    size_t length = strlen(name);
    for (double number = 0; values; number++) {
        const char *bar = strchr(values, '|');
        size_t size = bar ? (size_t)(bar - values) : strlen(values);
        if (size == length && memcmp(values, name, size) == 0) return number;
        values = bar ? bar + 1 : NULL;
    }
    return -1;
}

static inline int mishandle_read_scenario(struct mishandle_question *question, struct mishandle_text *text) {
    const struct mishandle_axis *axes = question->simulator->axes;
    char name[256], category[256];
    if (!mishandle_accept(text, '{')) return 0;
    if (mishandle_accept(text, '}')) return 1;
    do {
        size_t i = 0;
        if (!mishandle_read_string(text, name, sizeof name) || !mishandle_accept(text, ':')) return 0;
        while (i < MISHANDLE_MOST_NAMES && axes[i].name && strcmp(axes[i].name, name) != 0) i++;
        mishandle_skip_space(text);
        if (i == MISHANDLE_MOST_NAMES || !axes[i].name) {
            if (!mishandle_skip_value(text, 0)) return 0;
        } else if (text->at < text->end && *text->at == '"') {
            if (!mishandle_read_string(text, category, sizeof category)) return 0;
            question->scenario[i] = mishandle_category(axes[i].values, category);
            question->is_given[i] = question->scenario[i] >= 0;
            if (!question->is_given[i]) mishandle_fail(question, "unknown category of the axis ", name);
        } else if (mishandle_read_word(text, "null")) {
            question->scenario[i] = NAN; /* a draw that the scenario does not state */
            question->is_given[i] = 1;
        } else {
            if (!mishandle_read_number(text, &question->scenario[i])) return 0;
            question->is_given[i] = 1;
        }
    } while (mishandle_accept(text, ','));
    return mishandle_accept(text, '}');
}

static inline int mishandle_read_action(struct mishandle_question *question, struct mishandle_text *text) {
    question->action_count = 0;
    if (!mishandle_accept(text, '[')) return 0;
    if (mishandle_accept(text, ']')) return 1;
    do {
        double number;
        if (!mishandle_read_number(text, &number)) return 0;
        if (question->action_count < MISHANDLE_MOST_NUMBERS) question->action[question->action_count] = number;
        question->action_count++;
    } while (mishandle_accept(text, ','));
    return mishandle_accept(text, ']');
}

/* The seed is a text of digits, because 64 bits do not fit a double. */
static inline int mishandle_read_seed(struct mishandle_question *question, struct mishandle_text *text) {
    char digits[32];
    if (!mishandle_read_string(text, digits, sizeof digits) || digits[0] == '\0') return 0;
    question->seed = 0;
    for (const char *at = digits; *at; at++) {
        unsigned digit = (unsigned)(*at - '0');
        if (digit > 9 || question->seed > (UINT64_MAX - digit) / 10) return 0;
        question->seed = question->seed * 10 + digit;
    }
    return 1;
}

static inline int mishandle_read_question(struct mishandle_question *question, struct mishandle_text *text) {
    char key[32];
    if (!mishandle_accept(text, '{')) return 0;
    if (mishandle_accept(text, '}')) return 1;
    do {
        double number;
        int is_read;
        if (!mishandle_read_string(text, key, sizeof key) || !mishandle_accept(text, ':')) return 0;
        if (strcmp(key, "id") == 0) {
            is_read = mishandle_read_number(text, &number) && number >= 0 && number < 9007199254740992.0;
            if (is_read) question->id = (uint64_t)number;
        } else if (strcmp(key, "type") == 0) {
            is_read = mishandle_read_string(text, question->type, sizeof question->type);
        } else if (strcmp(key, "seed") == 0) {
            is_read = mishandle_read_seed(question, text);
        } else if (strcmp(key, "scenario") == 0) {
            is_read = mishandle_read_scenario(question, text);
        } else if (strcmp(key, "action") == 0) {
            is_read = mishandle_read_action(question, text);
        } else {
            is_read = mishandle_skip_value(text, 0);
        }
        if (!is_read) return 0;
    } while (mishandle_accept(text, ','));
    if (!mishandle_accept(text, '}')) return 0;
    mishandle_skip_space(text);
    return text->at == text->end;
}

/* ---- Writing an answer ---- */

struct mishandle_output {
    int descriptor, has_failed;
    size_t used;
    char bytes[1 << 14];
};

static inline void mishandle_flush(struct mishandle_output *out) {
    size_t done = 0;
#ifdef MISHANDLE_HAS_DESCRIPTORS
    while (done < out->used && !out->has_failed) {
        long written = (long)write(out->descriptor, out->bytes + done, out->used - done);
        if (written > 0) done += (size_t)written;
        else if (errno != EINTR) out->has_failed = 1;
    }
#else
    done = fwrite(out->bytes, 1, out->used, stdout);
    out->has_failed |= done < out->used || fflush(stdout) != 0;
#endif
    out->used = 0;
}

static inline void mishandle_write(struct mishandle_output *out, const char *text) {
    for (; *text; text++) {
        if (out->used == sizeof out->bytes) mishandle_flush(out);
        out->bytes[out->used++] = *text;
    }
}

static inline void mishandle_write_number(struct mishandle_output *out, double number) {
    char digits[40];
    snprintf(digits, sizeof digits, "%.17g", number);
    mishandle_write(out, isfinite(number) ? digits : "null");
}

/* Returns the number of bytes of the character at the start of a text in UTF-8, or 0 if it is none. */
static inline size_t mishandle_character(const char *text, size_t length) {
    unsigned char lead = (unsigned char)text[0], next = length > 1 ? (unsigned char)text[1] : 0;
    size_t count = lead < 0x80 ? 1 : lead < 0xC2 ? 0 : lead < 0xE0 ? 2 : lead < 0xF0 ? 3 : lead < 0xF5 ? 4 : 0;
    if (count > length) return 0;
    for (size_t i = 1; i < count; i++)
        if (((unsigned char)text[i] & 0xC0) != 0x80) return 0;
    /* Not the shortest form, halves of surrogate pairs, and more than 21 bits. */
    if ((lead == 0xE0 && next < 0xA0) || (lead == 0xED && next > 0x9F)) return 0;
    return (lead == 0xF0 && next < 0x90) || (lead == 0xF4 && next > 0x8F) ? 0 : count;
}

/* Writes the first `length` bytes of a text as a JSON string, with `?` for what is not UTF-8. */
static inline void mishandle_write_part(struct mishandle_output *out, const char *text, size_t length) {
    mishandle_write(out, "\"");
    for (size_t i = 0; i < length;) {
        size_t count = mishandle_character(text + i, length - i);
        char c = count ? text[i] : '?', bytes[8] = {0};
        if ((unsigned char)c < 0x20) snprintf(bytes, sizeof bytes, "\\u%04x", (unsigned)c);
        else if (c == '"' || c == '\\') snprintf(bytes, sizeof bytes, "\\%c", c);
        else if (count > 1) memcpy(bytes, text + i, count);
        else bytes[0] = c;
        mishandle_write(out, bytes);
        i += count ? count : 1;
    }
    mishandle_write(out, "\"");
}

static inline void mishandle_write_string(struct mishandle_output *out, const char *text) {
    mishandle_write_part(out, text ? text : "", text ? strlen(text) : 0);
}

static inline void mishandle_write_field(struct mishandle_output *out, const char *key, const char *text) {
    mishandle_write(out, key);
    mishandle_write_string(out, text);
}

/* Writes the bounds and the nominal value of an axis; of categories, the names of all and of the nominal one. */
static inline void mishandle_write_range(struct mishandle_output *out, const struct mishandle_axis *axis) {
    const char *nominal = axis->values, *values = axis->values;
    if (values && strchr(values, '|')) {
        for (const char *separator = ",\"values\":["; values; separator = ",") {
            const char *bar = strchr(values, '|');
            mishandle_write(out, separator);
            mishandle_write_part(out, values, bar ? (size_t)(bar - values) : strlen(values));
            values = bar ? bar + 1 : NULL;
        }
        for (double number = 1; number <= axis->nominal && strchr(nominal, '|'); number++)
            nominal = strchr(nominal, '|') + 1;
        mishandle_write(out, "],\"nominal\":");
        mishandle_write_part(out, nominal, strcspn(nominal, "|"));
        return;
    }
    if (values) mishandle_write_field(out, ",\"values\":", values);
    mishandle_write(out, ",\"low\":");
    mishandle_write_number(out, axis->low);
    mishandle_write(out, ",\"high\":");
    mishandle_write_number(out, axis->high);
    mishandle_write(out, ",\"nominal\":");
    mishandle_write_number(out, axis->nominal);
}

static inline void mishandle_write_axis(struct mishandle_output *out, const struct mishandle_axis *axis) {
    mishandle_write_field(out, "{\"name\":", axis->name);
    mishandle_write_field(out, ",\"unit\":", axis->unit);
    if (axis->kind) mishandle_write_field(out, ",\"kind\":", axis->kind);
    mishandle_write_range(out, axis);
    mishandle_write(out, "}");
}

static inline void mishandle_write_quantities(struct mishandle_output *out, const char *key,
                                              const struct mishandle_quantity *list, int has_size) {
    mishandle_write(out, key);
    for (size_t i = 0; i < mishandle_count(list); i++) {
        mishandle_write_field(out, i ? ",{\"name\":" : "{\"name\":", list[i].name);
        mishandle_write_field(out, ",\"unit\":", list[i].unit);
        if (has_size) {
            mishandle_write(out, ",\"size\":");
            mishandle_write_number(out, (double)(list[i].size ? list[i].size : 1));
        }
        mishandle_write(out, "}");
    }
    mishandle_write(out, "]");
}

static inline void mishandle_write_hello(struct mishandle_output *out, const struct mishandle_simulator *simulator) {
    mishandle_write_field(out, ",\"protocol\":1,\"name\":", simulator->name);
    mishandle_write_field(out, ",\"version\":", simulator->version);
    mishandle_write(out, ",\"control_dt\":");
    mishandle_write_number(out, simulator->control_dt);
    mishandle_write(out, ",\"steps\":");
    mishandle_write_number(out, (double)simulator->steps);
    mishandle_write(out, ",\"axes\":[");
    for (size_t i = 0; i < MISHANDLE_MOST_NAMES && simulator->axes[i].name; i++) {
        mishandle_write(out, i ? "," : "");
        mishandle_write_axis(out, &simulator->axes[i]);
    }
    mishandle_write_quantities(out, "],\"signals\":[", simulator->signals, 0);
    mishandle_write(out, ",\"formulas\":[");
    for (size_t i = 0; i < MISHANDLE_MOST_NAMES && simulator->formulas[i].name; i++) {
        mishandle_write_field(out, i ? ",{\"name\":" : "{\"name\":", simulator->formulas[i].name);
        mishandle_write_field(out, ",\"text\":", simulator->formulas[i].text);
        mishandle_write(out, "}");
    }
    mishandle_write(out, simulator->is_random ? "],\"deterministic\":false" : "],\"deterministic\":true");
    mishandle_write(out, simulator->is_seeded ? ",\"seeded\":true" : ",\"seeded\":false");
    mishandle_write(out, simulator->simulate ? ",\"mode\":\"trace\"" : ",\"mode\":\"step\"");
    if (mishandle_count(simulator->action) > 0) {
        mishandle_write_quantities(out, ",\"policy\":{\"observation\":[", simulator->observation, 1);
        mishandle_write_quantities(out, ",\"action\":[", simulator->action, 1);
        mishandle_write(out, ",\"action_limit\":");
        mishandle_write_number(out, simulator->action_limit);
        mishandle_write(out, "}");
    }
    if (simulator->more) {
        mishandle_write(out, ",");
        mishandle_write(out, simulator->more);
    }
}

/* Writes a list of numbers that are `stride` apart. */
static inline void mishandle_write_numbers(struct mishandle_output *out, const double *numbers, size_t count,
                                           size_t stride) {
    mishandle_write(out, "[");
    for (size_t i = 0; i < count; i++) {
        if (i) mishandle_write(out, ",");
        mishandle_write_number(out, numbers[i * stride]);
    }
    mishandle_write(out, "]");
}

static inline void mishandle_write_trace(struct mishandle_output *out, const struct mishandle_question *question) {
    size_t count = mishandle_count(question->simulator->signals);
    mishandle_write(out, ",\"trace\":{");
    for (size_t i = 0; i < count; i++) {
        mishandle_write_field(out, i ? "," : "", question->simulator->signals[i].name);
        mishandle_write(out, ":");
        mishandle_write_numbers(out, question->trace + i, question->samples, count);
    }
    mishandle_write(out, "}");
}

static inline void mishandle_write_state(struct mishandle_output *out, const struct mishandle_question *question) {
    const struct mishandle_simulator *simulator = question->simulator;
    mishandle_write(out, ",\"signals\":");
    mishandle_write_numbers(out, question->trace, mishandle_count(simulator->signals), 1);
    if (mishandle_count(simulator->action) > 0) {
        mishandle_write(out, ",\"observation\":");
        mishandle_write_numbers(out, question->observation, mishandle_numbers(simulator->observation), 1);
    }
}

static inline void mishandle_write_end(struct mishandle_output *out, const struct mishandle_question *question) {
    static const char *const names[] = {"", "terminated", "diverged", "invalid"};
    if (question->ending == MISHANDLE_COMPLETE) return;
    mishandle_write_field(out, ",\"end\":", names[question->ending]);
    if (question->reason[0]) mishandle_write_field(out, ",\"reason\":", question->reason);
}

/* ---- Answering ---- */

/* Checks the question, and runs the function of the simulator that it names. */
static inline void mishandle_run(struct mishandle_question *question, int *has_started) {
    const struct mishandle_simulator *simulator = question->simulator;
    void (*function)(struct mishandle_question *) = strcmp(question->type, "simulate") == 0 ? simulator->simulate
                                                    : strcmp(question->type, "reset") == 0  ? simulator->reset
                                                    : strcmp(question->type, "step") == 0   ? simulator->step
                                                                                            : NULL;
    if (!function) {
        mishandle_fail(question, "unknown type of question: ", question->type);
    } else if (function == simulator->step) {
        if (!*has_started) mishandle_fail(question, "a step before the first reset", "");
        if (question->action_count != mishandle_numbers(simulator->action))
            mishandle_fail(question, "wrong number of actions", "");
    } else {
        for (size_t i = 0; i < MISHANDLE_MOST_NAMES && simulator->axes[i].name; i++)
            if (!question->is_given[i]) mishandle_fail(question, "the scenario lacks the axis ", simulator->axes[i].name);
    }
    if (question->error[0]) return;
    *has_started = 1;
    function(question);
    if (question->ending == MISHANDLE_INVALID || question->ending == MISHANDLE_DIVERGED) return;
    if (simulator->simulate && question->ending == MISHANDLE_COMPLETE && question->samples != simulator->steps + 1)
        mishandle_fail(question, "fewer samples than steps + 1, and no end", "");
    if (!simulator->simulate && question->samples == 0) mishandle_fail(question, question->type, ": no sample");
    if (!simulator->simulate && mishandle_count(simulator->action) > 0 && !question->is_observed)
        mishandle_fail(question, question->type, ": no observation");
}

static inline void mishandle_answer(struct mishandle_question *question, struct mishandle_output *out,
                                    struct mishandle_text text, int is_too_long, int *has_started) {
    char id[40];
    int is_hello = 0;
    if (is_too_long) {
        mishandle_fail(question, "the question is longer than MISHANDLE_LONGEST_LINE", "");
    } else if (!mishandle_read_question(question, &text)) {
        question->error[0] = '\0';
        mishandle_fail(question, "the question is not a JSON object of the protocol", "");
    } else {
        is_hello = strcmp(question->type, "hello") == 0;
        if (!is_hello) mishandle_run(question, has_started);
    }
    fflush(stdout);             /* prints of the simulator, which go to standard error */
    setlocale(LC_NUMERIC, "C"); /* the simulator may have chosen a locale with a decimal comma */
    snprintf(id, sizeof id, "{\"id\":%llu", (unsigned long long)question->id);
    mishandle_write(out, id);
    if (question->error[0]) {
        mishandle_write_field(out, ",\"error\":", question->error);
    } else if (is_hello) {
        mishandle_write_hello(out, question->simulator);
    } else {
        if (question->simulator->simulate && question->ending != MISHANDLE_INVALID) mishandle_write_trace(out, question);
        if (!question->simulator->simulate && question->samples > 0 &&
            (question->is_observed || mishandle_count(question->simulator->action) == 0))
            mishandle_write_state(out, question);
        mishandle_write_end(out, question);
    }
    mishandle_write(out, "}\n");
    mishandle_flush(out);
}

/* Returns what is wrong with the simulator, or NULL. */
static inline const char *mishandle_mistake(const struct mishandle_simulator *simulator) {
    int is_trace = simulator->simulate && !simulator->reset && !simulator->step;
    int is_step = !simulator->simulate && simulator->reset && simulator->step;
    size_t signals = mishandle_count(simulator->signals);
    if (!is_trace && !is_step) return "set either simulate, or reset and step";
    if (signals == 0) return "it has no signals";
    if (is_trace && simulator->steps >= MISHANDLE_MOST_SAMPLES / signals) return "define a larger MISHANDLE_MOST_SAMPLES";
    if (mishandle_numbers(simulator->observation) > MISHANDLE_MOST_NUMBERS ||
        mishandle_numbers(simulator->action) > MISHANDLE_MOST_NUMBERS)
        return "define a larger MISHANDLE_MOST_NUMBERS";
    if ((mishandle_count(simulator->observation) > 0) != (mishandle_count(simulator->action) > 0))
        return "an observation needs an action, and an action an observation";
    if (mishandle_count(simulator->action) > 0 && !(simulator->action_limit > 0)) return "an action needs action_limit";
    if (is_trace && mishandle_count(simulator->action) > 0) return "a simulator with an action needs reset and step";
    return NULL;
}

/* Reads one line without its end. Returns 0 at the end of the input. */
static inline int mishandle_read_line(char *line, struct mishandle_text *text, int *is_too_long) {
    size_t length = 0;
    int c;
    *is_too_long = 0;
    while ((c = getc(stdin)) != EOF && c != '\n') {
        if (length + 1 < MISHANDLE_LONGEST_LINE) line[length++] = (char)c;
        else *is_too_long = 1;
    }
    line[length] = '\0';
    text->at = line;
    text->end = line + length;
    return c != EOF;
}

/* Answers questions until standard input is closed. Returns the exit code of the program. */
static inline int mishandle_serve(const struct mishandle_simulator *simulator) {
    static struct mishandle_question question;
    static struct mishandle_output out;
    static char line[MISHANDLE_LONGEST_LINE];
    struct mishandle_text text;
    int is_too_long, has_started = 0;
    const char *mistake = mishandle_mistake(simulator);
    if (mistake) {
        fprintf(stderr, "mishandle_serve: %s\n", mistake);
        return 2;
    }
#ifdef MISHANDLE_HAS_DESCRIPTORS
    fflush(stdout);
    out.descriptor = dup(STDOUT_FILENO);
    if (out.descriptor < 0 || dup2(STDERR_FILENO, STDOUT_FILENO) < 0) return 2;
#endif
    question.simulator = simulator;
    for (;;) {
        question.id = question.seed = 0;
        question.type[0] = question.reason[0] = question.error[0] = '\0';
        question.action_count = question.samples = 0;
        question.is_observed = 0;
        question.ending = MISHANDLE_COMPLETE;
        memset(question.is_given, 0, sizeof question.is_given);
        if (!mishandle_read_line(line, &text, &is_too_long)) return 0;
        setlocale(LC_NUMERIC, "C");
        mishandle_answer(&question, &out, text, is_too_long, &has_started);
        if (out.has_failed) return 1;
    }
}

#endif
