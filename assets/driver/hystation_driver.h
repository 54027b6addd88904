/* hystation_driver.h: what a driver of a haptic device needs to take the place of the simulated one (`hystation run --driver ./my-driver`).
 * C11, Linux on x86-64, nothing but the C library (-pthread -lm). docs/driver.md says what a driver must state and do.
 *
 *     int main(int argc, char **argv) {
 *         static hyst_driver driver;
 *         int code = hyst_begin(&driver, argc, argv);
 *         if (code >= 0) return code;                          // asked what it is, or wrong arguments
 *         ...open the device; if it is not there: return hyst_fail(&driver, 2, "what, and what to do")
 *         hyst_state(&driver, &statement);
 *         hyst_real_time(&driver);
 *         while (hyst_goes_on(&driver)) {                      // until the station stops
 *             hyst_wait(&driver, 1000000);                     // or wait for the device's own clock
 *             float force_n[3];
 *             hyst_take(&driver, force_n);                     // checked, limited, ramped to zero when the station is silent
 *             ...give force_n to the motors; read the encoders into sample
 *             hyst_from_window(&driver, &sample, HYST_WINDOW_LIGHT); // what the device has nothing for, if there is something
 *             hyst_give(&driver, &sample);
 *         }
 *         return hyst_end(&driver);                            // and let the motors go
 *     }
 *
 * SI units. World frame: metres, right-handed, origin at the pivot in the cervix, +z into the uterus, +y anterior, +x to the patient's right, which is on
 * the picture's left. Where a scene has its pivot elsewhere hyst_give adds that.
 * A force is what the hand is to feel at the tip, N, in that frame.
 *
 * One thread at a time calls these functions. Of a device whose library has a servo loop of its own `main` calls all up to hyst_state, and hyst_end; its
 * callback calls hyst_real_time, which is about the thread that calls it, once, and then take, from_window and give in each turn, without hyst_wait. Any
 * thread may call hyst_goes_on. The thread that called hyst_begin stays for as long as the driver: by its end the station knows that the driver has died.
 */
#ifndef HYSTATION_DRIVER_H
#define HYSTATION_DRIVER_H

#ifdef __cplusplus
#error "this is C11: compile the driver as C, and what is C++ of the device's library beside it"
#endif
#ifndef _GNU_SOURCE
#error "define _GNU_SOURCE before the first header: real time and robust mutexes need it"
#endif
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/futex.h>
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

/* Where things lie. tests/tests/driver.rs compares these lines with the station's own layouts (HYSTATION_HEADER=write writes them). */
/* layout begins */
#define HYST_LAYOUT_VERSION 23u
#define HYST_LAYOUT_HASH 0x39a285e65abf74f2u
#define HYST_INTERFACE_VERSION 2u
#define HYST_MAGIC_WORD 0
#define HYST_PID 3
#define HYST_HEARTBEAT_NS 4
#define HYST_TICK 5
#define HYST_STEPS 6
#define HYST_VALUE_NS 8
#define HYST_INVALID 10
#define HYST_REAL_TIME 15
#define HYST_DISTRUSTED 20
#define HYST_LATCH 44
#define HYST_LAST_WORDS 384
#define HYST_LAST_WORDS_WORDS 64
#define HYST_STATE 0
#define HYST_SAMPLE 512
#define HYST_LEDGER 546
#define HYST_LEDGER_ENTRIES 16384
#define HYST_TOTALS 148003
#define HYST_TRACE_HASH 6
#define HYST_INVALID_APPLIED 7
#define HYST_STALE_APPLIED 8
#define HYST_FORCE_STEP_MAX 9
#define HYST_TRIPS 10
#define HYST_STATEMENT 148121
#define HYST_HARDWARE_WORDS 148159
#define HYST_COMMAND 5859
#define HYST_DEVICE_WORDS 206586
#define HYST_STATION_WORDS 288
#define HYST_T0_NS 1
#define HYST_STOP 1
#define HYST_SLOT_INCARNATION 64
#define HYST_WORDS32 1024
#define HYST_DISTRUST_INVALID 1
#define HYST_SAMPLE_BYTES 120
#define HYST_COMMAND_BYTES 40
#define HYST_STATEMENT_BYTES 136
#define HYST_LEDGER_ENTRY_BYTES 56
#define HYST_POINTER 512
#define HYST_POINTER_BYTES 56
#define HYST_RENDERING_WORDS 714
#define HYST_WINDOW_HEAD 2
#define HYST_WINDOW_LOOP 4
#define HYST_WINDOW_CURRENT 8
#define HYST_WINDOW_INFLOW 16
#define HYST_WINDOW_OUTFLOW 32
#define HYST_WINDOW_PRESSURE 64
#define HYST_WINDOW_LIGHT 128
#define HYST_WINDOW_FOCUS 256
#define HYST_WINDOW_COAGULATION 512
#define HYST_HARDWARE_SLOT 0u
#define HYST_DEVICE_SLOT 1u
#define HYST_RENDERING_SLOT 10u
/* layout ends */

#define HYST_STATEMENT_VERSION 1u
#define HYST_ENERGIZED 1u   /* hyst_controls.buttons: the hand wants the current that cuts in the loop */
#define HYST_EXTENDED 2u    /* ... and this: it wants the loop out */
#define HYST_COAGULATING 4u /* ... and this: it wants the current that coagulates; of both at once the loop cuts */
/* All that the window's keys can set beside a device: of one that measures where the tip is, and nothing else. */
#define HYST_WINDOW_CONTROLS (HYST_WINDOW_HEAD | HYST_WINDOW_LOOP | HYST_WINDOW_CURRENT | HYST_WINDOW_INFLOW | HYST_WINDOW_OUTFLOW | \
                              HYST_WINDOW_PRESSURE | HYST_WINDOW_LIGHT | HYST_WINDOW_FOCUS | HYST_WINDOW_COAGULATION)

typedef struct {
    float position_m[3];    /* tip, about the pivot */
    float pitch_rad;        /* about x */
    float orientation[4];   /* unit quaternion x, y, z, w; its +z is the scope's axis, inwards */
    float yaw_rad;          /* about y */
    float roll_rad;         /* about the scope's axis */
    float insertion_m;      /* from the pivot to the tip */
    float camera_roll_rad;  /* camera head against the scope */
} hyst_pose;

typedef struct {
    uint32_t buttons;       /* HYST_ENERGIZED, HYST_EXTENDED, HYST_COAGULATING */
    float inflow_valve;     /* 0 shut to 1 open */
    float outflow_valve;
    float set_pressure_pa;
    float light;            /* 0 to 1 */
    float loop_extension_m; /* of a loop beyond the sheath; of jaws from tip to tip */
    float focus_m;          /* of the camera head: distance from the lens that is sharp, 0.003 to 0.1; 0: it has none, the usual one is shown */
} hyst_controls;

typedef struct {
    uint64_t hardware_tick; /* counts the samples; hyst_give sets it */
    uint64_t time_ns;       /* CLOCK_MONOTONIC of the encoders' reading; hyst_give sets it if it is 0 */
    hyst_pose pose;
    float velocity_m_s[3];  /* of the tip */
    float force_n[3];       /* that the motors make at this moment */
    hyst_controls controls;
    uint32_t from_window;   /* what of it comes from the window's keys, HYST_WINDOW_... each: hyst_from_window sets it; 0 if nothing does */
} hyst_sample;

typedef struct {
    uint64_t sequence;      /* counts records: a window that lives says one a hundred times a second */
    float target[5];        /* pitch, yaw, roll, insertion, and the horizon: how far the camera head is turned on the scope and the scope itself, rad */
    hyst_controls controls;
} hyst_pointer;             /* what the window's keys say */

typedef struct {
    uint64_t tick;          /* of the station, when it was written */
    uint64_t force_tick;    /* of the input that the force was computed from */
    float force_n[3];
    uint32_t kind;          /* 0 fresh, 1 held, 2 on the way to zero, 3 zero */
    uint32_t source_incarnation;
    uint32_t device_incarnation;
} hyst_command;

typedef struct {
    uint32_t version;             /* HYST_STATEMENT_VERSION */
    uint32_t measured_dof;        /* 3 to 7: pitch, yaw, insertion at least */
    uint32_t driven_dof;          /* 1 to 6 */
    float rate_hz;                /* samples in a second, 500 to 10 000 */
    float max_force_n;            /* for short, 0.1 to 100 */
    float max_stiffness_n_m;      /* that it makes stably, 10 to 100 000 */
    float max_damping_n_s_m;      /* likewise, 0.01 to 1 000 */
    float continuous_force_n;     /* for any time; no more than max_force_n */
    float resolution_m;           /* smallest motion of the tip that is measured; 0 if that is not known */
    float device_damping_n_s_m;   /* physical, in the hand that holds it most lightly, 0.05 to 100; 0 if that is not known: then 3 are relied on */
    float pitch_rad[2];           /* least and greatest */
    float yaw_rad[2];
    float roll_rad[2];
    float insertion_m[2];
    char maker[32];               /* UTF-8, ended by a zero */
    char name[32];
} hyst_statement;

typedef struct {
    uint64_t hardware_tick, time_ns, station_tick, force_tick;
    float force_n[3];
    uint32_t kind, source_incarnation, is_void;
} hyst_ledger_entry;

_Static_assert(sizeof(hyst_sample) == HYST_SAMPLE_BYTES && sizeof(hyst_command) == HYST_COMMAND_BYTES &&
               sizeof(hyst_statement) == HYST_STATEMENT_BYTES && sizeof(hyst_ledger_entry) == HYST_LEDGER_ENTRY_BYTES &&
               sizeof(hyst_pointer) == HYST_POINTER_BYTES, "the station's layouts");

typedef struct {
    _Atomic uint32_t *words32;
    _Atomic uint64_t *words64;
    size_t bytes;
} hyst_page;

typedef struct {
    char station[32];
    uint32_t incarnation;
    hyst_page own, clock, device;
    hyst_statement stated;
    uint32_t device_incarnation; /* whose page `device` is; 0 if none */
    hyst_command command;        /* the newest that was followed */
    float command_n[3];          /* its force */
    uint32_t silent_ticks;       /* since then */
    uint64_t tick;               /* samples given */
    uint64_t due_ns;             /* when hyst_wait wakes next */
    uint64_t newest_force_tick, trace;
    float last_n[3];
    hyst_page window;            /* rendering's, once hyst_from_window has looked */
    uint32_t window_incarnation;
    float pivot_m[3];            /* where the scene has its pivot: hyst_give adds it to position_m */
    hyst_pointer pointer;        /* what the window said last */
    uint64_t looked_ns;          /* when hyst_from_window looked last */
    uint64_t silent_ns;          /* for how long the window has said nothing new */
    float loop_reach_m;          /* how far the loop goes out, or jaws open, under the window's key: 0.012 unless the driver sets it after hyst_begin */
    float loop_extension_m;      /* how far it is */
} hyst_driver;

static inline uint64_t hyst_now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

/* ---- cells and rings: one writer, any number of readers; see shared/exchange/src/cell.rs for why these orderings suffice ---- */

static inline uint64_t hyst_hash(uint64_t seed, const uint64_t *words, size_t count) {
    uint64_t hash = seed ^ 0xcbf29ce484222325u;
    for (size_t i = 0; i < count; i++) {
        hash = (hash ^ words[i]) * 0x00000100000001b3u;
        hash = hash << 23 | hash >> 41;
    }
    return hash;
}

static inline void hyst_write_copy(_Atomic uint64_t *copy, uint64_t stamp, const uint64_t *record, size_t words) {
    atomic_store_explicit(copy, stamp - 1, memory_order_relaxed);
    atomic_thread_fence(memory_order_release); /* the odd stamp is there before any word of the record */
    atomic_store_explicit(copy + 1, hyst_hash(stamp, record, words), memory_order_relaxed);
    for (size_t i = 0; i < words; i++) atomic_store_explicit(copy + 2 + i, record[i], memory_order_relaxed);
    atomic_store_explicit(copy, stamp, memory_order_release); /* the record is there before the even stamp */
}

static inline void hyst_write_cell(_Atomic uint64_t *cell, const uint64_t *record, size_t words) {
    _Atomic uint64_t *second = cell + 2 + words;
    uint64_t a = atomic_load_explicit(cell, memory_order_relaxed), b = atomic_load_explicit(second, memory_order_relaxed);
    uint64_t number = (a > b ? a : b) / 2 + 1;
    hyst_write_copy(number % 2 == 0 ? cell : second, 2 * number, record, words);
}

/* The newest whole value; its number, or 0 if there is none. */
static inline uint64_t hyst_read_cell(_Atomic uint64_t *cell, uint64_t *record, size_t words) {
    for (int attempt = 0; attempt < 4; attempt++) { /* a writer would have to complete two writes during each */
        uint64_t stamp[2] = {atomic_load_explicit(cell, memory_order_acquire),
                             atomic_load_explicit(cell + 2 + words, memory_order_acquire)};
        if (stamp[0] == 0 && stamp[1] == 0) return 0;
        for (int i = 0; i < 2; i++) if (stamp[i] % 2 != 0) stamp[i] = 0;
        for (int turn = 0; turn < 2; turn++) {
            int i = (stamp[0] > stamp[1]) == (turn == 0) ? 0 : 1;
            _Atomic uint64_t *copy = i == 0 ? cell : cell + 2 + words;
            if (stamp[i] == 0) continue;
            uint64_t checksum = atomic_load_explicit(copy + 1, memory_order_relaxed);
            for (size_t w = 0; w < words; w++) record[w] = atomic_load_explicit(copy + 2 + w, memory_order_relaxed);
            atomic_thread_fence(memory_order_acquire); /* a word of a later write shows in the stamp below */
            if (atomic_load_explicit(copy, memory_order_relaxed) == stamp[i] && hyst_hash(stamp[i], record, words) == checksum)
                return stamp[i] / 2;
        }
    }
    return 0;
}

static inline void hyst_write_ring(_Atomic uint64_t *ring, size_t entries, uint64_t key, const uint64_t *record, size_t words) {
    hyst_write_copy(ring + 1 + key % entries * (2 + words), 2 * (key + 1), record, words);
    atomic_store_explicit(ring, key + 1, memory_order_release);
}

/* ---- pages ---- */

static inline uint64_t hyst_load(const hyst_page *page, size_t word) {
    return atomic_load_explicit(page->words64 + word, memory_order_acquire);
}
static inline void hyst_store(hyst_page *page, size_t word, uint64_t value) {
    atomic_store_explicit(page->words64 + word, value, memory_order_release);
}
static inline void hyst_add(hyst_page *page, size_t word, uint64_t value) {
    hyst_store(page, word, atomic_load_explicit(page->words64 + word, memory_order_relaxed) + value);
}
static inline uint32_t hyst_load32(const hyst_page *page, size_t word) {
    return atomic_load_explicit(page->words32 + word, memory_order_acquire);
}

/* Maps a page of so many 64-bit words, or its first bytes alone; 0 if that is refused, or it is of another version. */
static inline int hyst_map(hyst_page *page, const char *path, size_t words, size_t mapped_words, int may_write) {
    size_t whole = (4 * HYST_WORDS32 + 8 * words + 4095) / 4096 * 4096;
    size_t bytes = (4 * HYST_WORDS32 + 8 * mapped_words + 4095) / 4096 * 4096;
    int file = open(path, (may_write ? O_RDWR : O_RDONLY) | O_CLOEXEC);
    if (file < 0) return 0;
    struct stat found;
    void *start = MAP_FAILED;
    if (fstat(file, &found) == 0 && (size_t)found.st_size == whole)
        start = mmap(NULL, bytes, PROT_READ | (may_write ? PROT_WRITE : 0), MAP_SHARED | MAP_POPULATE, file, 0);
    close(file);
    if (start == MAP_FAILED) return 0;
    hyst_page made = {(_Atomic uint32_t *)start, (_Atomic uint64_t *)((char *)start + 4 * HYST_WORDS32), bytes};
    if (hyst_load(&made, HYST_MAGIC_WORD) != (0x4859535450414745u ^ HYST_LAYOUT_HASH)) { /* "HYSTPAGE" */
        munmap(start, bytes);
        return 0;
    }
    *page = made;
    return 1;
}

static inline void hyst_set_state(hyst_driver *driver, uint32_t state) {
    _Atomic uint32_t *word = driver->own.words32 + HYST_STATE;
    atomic_store_explicit(word, state, memory_order_release);
    syscall(SYS_futex, word, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}

static inline void hyst_root(const hyst_driver *driver, char *path, size_t size, const char *file) {
    snprintf(path, size, "/dev/shm/hystation-%u-%s/%s", (unsigned)getuid(), driver->station, file);
}

/* ---- a life: begin, state, go on, end ---- */

/* Says why it cannot go on: on stderr, which is the process's log, and in its page. Code 2: a restart would not help, and the station ends;
 * 1: it is started again. */
static inline int hyst_fail(hyst_driver *driver, int code, const char *why) {
    fprintf(stderr, "%s\n", why);
    if (driver->own.words64 == NULL) return code;
    uint64_t words[HYST_LAST_WORDS_WORDS] = {0};
    size_t length = strlen(why), most = sizeof words - 1;
    memcpy(words, why, length < most ? length : most);
    for (size_t i = 0; i < HYST_LAST_WORDS_WORDS; i++) hyst_store(&driver->own, HYST_LAST_WORDS + i, words[i]);
    hyst_set_state(driver, 5);
    return code;
}

/* The kernel marks this lock when the thread that holds it dies, whatever of: so a death is seen at once. */
static inline void hyst_hold_latch(hyst_driver *driver) {
    pthread_mutexattr_t kind;
    pthread_mutex_t *latch = (pthread_mutex_t *)(void *)(driver->own.words64 + HYST_LATCH);
    if (pthread_mutexattr_init(&kind) != 0) return;
    if (pthread_mutexattr_setrobust(&kind, PTHREAD_MUTEX_ROBUST) == 0 && pthread_mutexattr_setpshared(&kind, PTHREAD_PROCESS_SHARED) == 0 &&
        pthread_mutex_init(latch, &kind) == 0)
        pthread_mutex_lock(latch);
    pthread_mutexattr_destroy(&kind);
}

/* Where the scene has its pivot: three floats of a file in the station's root. A bench has no scene, and there it is the origin. */
static inline int hyst_read_pivot(hyst_driver *driver) {
    char path[256];
    hyst_root(driver, path, sizeof path, "pivot");
    FILE *file = fopen(path, "r");
    if (file == NULL) return errno == ENOENT;
    size_t found = fread(driver->pivot_m, sizeof driver->pivot_m, 1, file);
    fclose(file);
    return found == 1;
}

/* Reads the command line and opens the pages. Below 0: go on; else end with this exit code, everything is said. */
static inline int hyst_begin(hyst_driver *driver, int argc, char **argv) {
    memset(driver, 0, sizeof *driver);
    driver->loop_reach_m = 0.012f;
    if (argc == 2 && strcmp(argv[1], "--describe") == 0) {
        printf("{\"engine_of\":\"hystation\",\"role\":\"hardware\",\"layout\":%u,\"layout_hash\":\"%016llx\",\"interface\":%u}\n",
               HYST_LAYOUT_VERSION, (unsigned long long)HYST_LAYOUT_HASH, HYST_INTERFACE_VERSION);
        return 0;
    }
    char *end = NULL, path[256], file[64];
    int is_call = argc == 7 && strcmp(argv[1], "--station") == 0 && strcmp(argv[3], "--slot") == 0 &&
                  strcmp(argv[4], "hardware") == 0 && strcmp(argv[5], "--incarnation") == 0;
    unsigned long incarnation = is_call ? strtoul(argv[6], &end, 10) : 0;
    if (!is_call || *argv[6] == 0 || *end != 0 || incarnation == 0 || incarnation > UINT32_MAX || strlen(argv[2]) >= sizeof driver->station)
        return hyst_fail(driver, 2, "this is a driver of hystation; start it with `hystation run --driver FILE`");
    strcpy(driver->station, argv[2]);
    driver->incarnation = (uint32_t)incarnation;
    hyst_root(driver, path, sizeof path, "pages/station.page");
    int is_open = hyst_map(&driver->clock, path, HYST_STATION_WORDS, HYST_STATION_WORDS, 0);
    snprintf(file, sizeof file, "pages/%02u-%lu.page", HYST_HARDWARE_SLOT, incarnation);
    hyst_root(driver, path, sizeof path, file);
    if (!is_open || !hyst_map(&driver->own, path, HYST_HARDWARE_WORDS, HYST_HARDWARE_WORDS, 1))
        return hyst_fail(driver, 2, "the station's pages cannot be opened, or are of another version: build the driver with the header of this station");
    uint64_t nobody = 0;
    if (!atomic_compare_exchange_strong(driver->own.words64 + HYST_PID, &nobody, (uint64_t)getpid())) {
        driver->own.words64 = NULL;
        return hyst_fail(driver, 2, "this life is another process's; start drivers with `hystation run --driver FILE`");
    }
    if (!hyst_read_pivot(driver)) return hyst_fail(driver, 2, "where the scene has its pivot cannot be read: start the station anew");
    hyst_store(&driver->own, HYST_HEARTBEAT_NS, hyst_now_ns());
    hyst_set_state(driver, 1);
    hyst_hold_latch(driver);
    return -1;
}

/* Says that the driver lives, while it is long in opening the device: 25 s are given. */
static inline void hyst_heartbeat(hyst_driver *driver) { hyst_store(&driver->own, HYST_HEARTBEAT_NS, hyst_now_ns()); }

/* States what the device is; once, before the first sample. */
static inline void hyst_state(hyst_driver *driver, const hyst_statement *statement) {
    uint64_t record[sizeof(hyst_statement) / 8];
    driver->stated = *statement;
    memcpy(record, statement, sizeof record);
    hyst_write_cell(driver->own.words64 + HYST_STATEMENT, record, sizeof record / 8);
}

/* Memory locked, SCHED_FIFO above the station's engines, on the first core that the process may use, which is that of the `device` engine where all are alike,
 * unless the station was started with --set realtime=off. 0 if the system refuses: the driver runs as an ordinary process then. */
static inline int hyst_real_time(hyst_driver *driver) {
    char path[256], text[4096] = {0};
    hyst_root(driver, path, sizeof path, "settings.toml");
    FILE *settings = fopen(path, "r");
    size_t length = settings != NULL ? fread(text, 1, sizeof text - 1, settings) : 0;
    if (settings != NULL) fclose(settings);
    if (length > 0 && strstr(text, "realtime = \"off\"") != NULL) return 0;
    struct sched_param priority = {.sched_priority = 86};
    cpu_set_t allowed, core;
    CPU_ZERO(&allowed);
    CPU_ZERO(&core);
    int is_known = sched_getaffinity(0, sizeof allowed, &allowed) == 0, first = 0;
    while (first < CPU_SETSIZE - 1 && !CPU_ISSET(first, &allowed)) first++;
    CPU_SET(first, &core);
    int locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
    int pinned = is_known && (CPU_COUNT(&allowed) < 2 || sched_setaffinity(0, sizeof core, &core) == 0);
    int fifo = sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &priority) == 0;
    hyst_store(&driver->own, HYST_REAL_TIME, (uint64_t)(fifo | locked << 1 | pinned << 2));
    hyst_heartbeat(driver);
    return fifo;
}

/* Whether the station goes on. */
static inline int hyst_goes_on(hyst_driver *driver) { return hyst_load32(&driver->clock, HYST_STOP) == 0; }

/* Sleeps until the next period of the driver's own clock; periods that have passed are left out. */
static inline void hyst_wait(hyst_driver *driver, uint64_t period_ns) {
    uint64_t now_ns = hyst_now_ns();
    driver->due_ns += period_ns;
    if (driver->due_ns + period_ns < now_ns) driver->due_ns = now_ns;
    struct timespec due = {(time_t)(driver->due_ns / 1000000000u), (long)(driver->due_ns % 1000000000u)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) == EINTR) {}
}

/* ---- the force ---- */

static inline float hyst_length(const float v[3]) { return sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

/* The station's tick at a time. */
static inline uint64_t hyst_tick_at(const hyst_driver *driver, uint64_t time_ns) {
    uint64_t t0_ns = hyst_load(&driver->clock, HYST_T0_NS);
    return time_ns > t0_ns ? (time_ns - t0_ns) / 1000000u : 0;
}

/* Finds the page of the engine in a slot, of which the first words are mapped: another page after each of its deaths. `known` is whose page is there. */
static inline void hyst_look_for(const hyst_driver *driver, unsigned slot, size_t words, size_t mapped_words, hyst_page *page, uint32_t *known) {
    uint32_t incarnation = hyst_load32(&driver->clock, HYST_SLOT_INCARNATION + slot);
    if (incarnation == 0 || incarnation == *known) return;
    char path[256], file[64];
    hyst_page found;
    snprintf(file, sizeof file, "pages/%02u-%u.page", slot, incarnation);
    hyst_root(driver, path, sizeof path, file);
    if (!hyst_map(&found, path, words, mapped_words, 0)) return;
    if (page->words64 != NULL) munmap((void *)page->words32, page->bytes);
    *page = found;
    *known = incarnation;
}

/* Counts a command that no motor may follow, and names its writer, which the supervisor replaces. */
static inline void hyst_refuse(hyst_driver *driver) {
    uint64_t now_ns = hyst_now_ns(), entry = (uint64_t)HYST_DISTRUST_INVALID << 32 | driver->device_incarnation;
    hyst_add(&driver->own, HYST_INVALID, 1);
    if (hyst_load(&driver->own, HYST_DISTRUSTED) != entry) hyst_store(&driver->own, HYST_DISTRUSTED + 1, now_ns);
    hyst_store(&driver->own, HYST_DISTRUSTED + 2, now_ns);
    hyst_store(&driver->own, HYST_DISTRUSTED, entry);
}

/* The force that the motors are to make now, N, never longer than what was stated. A command counts if it is finite, no longer than that, newer than the
 * last, not from the future and of the last 8 ms: an older one stands in the page of an engine that has died or hangs, and the motors of a driver that was
 * just started would jump to it. Without one the last force is kept for 8 ms, then ramped to zero in 20, by the rate that was stated. Once
 * for each sample. */
static inline void hyst_take(hyst_driver *driver, float force_n[3]) {
    hyst_command command;
    uint64_t record[sizeof command / 8];
    float most_n = driver->stated.max_force_n;
    /* Up to the command: a mapping of 50 KiB takes some microseconds. */
    hyst_look_for(driver, HYST_DEVICE_SLOT, HYST_DEVICE_WORDS, HYST_COMMAND + 2 * (2 + sizeof command / 8), &driver->device, &driver->device_incarnation);
    driver->silent_ticks += driver->silent_ticks < UINT32_MAX;
    if (driver->device.words64 != NULL && hyst_read_cell(driver->device.words64 + HYST_COMMAND, record, sizeof record / 8) != 0) {
        memcpy(&command, record, sizeof command);
        uint64_t tick = hyst_tick_at(driver, hyst_now_ns());
        int is_sound = hyst_length(command.force_n) <= most_n * 1.00001f && command.force_tick <= command.tick && command.tick <= tick + 2; /* NaN is not */
        int is_over = tick > command.tick && tick - command.tick > 8; /* nobody is to blame */
        if (!is_sound) hyst_refuse(driver);
        if (is_sound && !is_over && command.tick > driver->command.tick) {
            driver->command = command;
            memcpy(driver->command_n, command.force_n, sizeof driver->command_n);
            driver->silent_ticks = 0;
        }
    }
    float per_ms = driver->stated.rate_hz / 1000.0f, ramped = (float)driver->silent_ticks - 8.0f * per_ms;
    float left = ramped <= 0.0f ? 1.0f : ramped < 20.0f * per_ms ? 1.0f - ramped / (20.0f * per_ms) : 0.0f;
    if (driver->silent_ticks == (uint32_t)(8.0f * per_ms) + 1) hyst_add(&driver->own, HYST_TOTALS + HYST_TRIPS, 1);
    for (int i = 0; i < 3; i++) force_n[i] = driver->command_n[i] * left;
}

/* ---- the window's keys ---- */

/* A value within what there is, or the other one; a NaN is not within. */
static inline float hyst_or(float value, float least, float most, float otherwise) { return value >= least && value <= most ? value : otherwise; }

/* Sets in a sample what the device has nothing for, HYST_WINDOW_... each, as the window's keys say it, and says so in the sample. Once for each sample, when
 * pose and controls are filled in: they stay as they are while there is no window, or it has said nothing yet. Of a window that has said nothing new for
 * 0.2 s no current is wanted any more; a pause of the whole machine does not count. The loop goes out and in at 30 mm/s. */
static inline void hyst_from_window(hyst_driver *driver, hyst_sample *sample, uint32_t lacks) {
    hyst_pointer pointer;
    uint64_t record[sizeof pointer / 8];
    hyst_controls *own = &sample->controls;
    uint64_t now_ns = hyst_now_ns(), passed_ns = now_ns - driver->looked_ns, before = driver->pointer.sequence;
    driver->looked_ns = now_ns;
    hyst_look_for(driver, HYST_RENDERING_SLOT, HYST_RENDERING_WORDS, HYST_POINTER + 2 * (2 + sizeof pointer / 8), &driver->window, &driver->window_incarnation);
    if (driver->window.words64 != NULL && hyst_read_cell(driver->window.words64 + HYST_POINTER, record, sizeof record / 8) != 0) {
        memcpy(&pointer, record, sizeof pointer);
        if (pointer.sequence > 0) driver->pointer = pointer;
    }
    driver->silent_ns = driver->pointer.sequence != before ? 0 : driver->silent_ns + (passed_ns < 5000000u ? passed_ns : 5000000u);
    if (driver->silent_ns >= 200000000u) driver->pointer.controls.buttons &= ~(HYST_ENERGIZED | HYST_COAGULATING);
    sample->from_window = lacks;
    if (driver->pointer.sequence > 0) {
        const hyst_controls *said = &driver->pointer.controls;
        uint32_t buttons = (lacks & HYST_WINDOW_LOOP ? HYST_EXTENDED : 0u) | (lacks & HYST_WINDOW_CURRENT ? HYST_ENERGIZED : 0u) |
                           (lacks & HYST_WINDOW_COAGULATION ? HYST_COAGULATING : 0u);
        float head_rad = driver->pointer.target[4] - sample->pose.roll_rad;
        own->buttons = (own->buttons & ~buttons) | (said->buttons & buttons);
        if (lacks & HYST_WINDOW_INFLOW) own->inflow_valve = hyst_or(said->inflow_valve, 0.0f, 1.0f, own->inflow_valve);
        if (lacks & HYST_WINDOW_OUTFLOW) own->outflow_valve = hyst_or(said->outflow_valve, 0.0f, 1.0f, own->outflow_valve);
        if (lacks & HYST_WINDOW_PRESSURE) own->set_pressure_pa = hyst_or(said->set_pressure_pa, 0.0f, 100000.0f, own->set_pressure_pa);
        if (lacks & HYST_WINDOW_LIGHT) own->light = hyst_or(said->light, 0.0f, 1.0f, own->light);
        if (lacks & HYST_WINDOW_FOCUS) own->focus_m = hyst_or(said->focus_m, 0.003f, 0.1f, own->focus_m);
        if (lacks & HYST_WINDOW_HEAD) sample->pose.camera_roll_rad = hyst_or(head_rad, -20.0f, 20.0f, sample->pose.camera_roll_rad);
    }
    if (lacks & HYST_WINDOW_LOOP) {
        float most_m = 0.030f / driver->stated.rate_hz;
        float left_m = (own->buttons & HYST_EXTENDED ? driver->loop_reach_m : 0.0f) - driver->loop_extension_m;
        driver->loop_extension_m += left_m > most_m ? most_m : left_m < -most_m ? -most_m : left_m;
        own->loop_extension_m = driver->loop_extension_m;
    }
}

/* ---- the sample ---- */

/* What the tick was, for the station's ledger: 0 fresh, 1 held, 2 ramped, 3 zero. */
static inline uint32_t hyst_kind(const hyst_driver *driver, const float force_n[3], uint64_t station_tick) {
    const hyst_command *command = &driver->command;
    int is_zero = force_n[0] == 0.0f && force_n[1] == 0.0f && force_n[2] == 0.0f;
    if (command->tick == 0) return 3;
    if (command->kind == 0 && command->force_tick + 1 >= station_tick) return 0;
    if (command->kind == 2 && !is_zero) return 2;
    if (command->kind == 3) return 3;
    return is_zero && driver->silent_ticks > 0 && hyst_length(driver->command_n) > 0.0f ? 3 : 1;
}

static inline void hyst_keep_ledger(hyst_driver *driver, const hyst_sample *sample) {
    const hyst_command *command = &driver->command;
    hyst_ledger_entry entry = {sample->hardware_tick, sample->time_ns, hyst_tick_at(driver, sample->time_ns), command->force_tick,
                               {sample->force_n[0], sample->force_n[1], sample->force_n[2]}, 0, command->source_incarnation, 0};
    entry.kind = hyst_kind(driver, sample->force_n, entry.station_tick);
    uint64_t record[sizeof entry / 8], bits[3] = {0}, step_bits, most_bits;
    double step = 0.0, most;
    for (int i = 0; i < 3; i++) {
        step += ((double)sample->force_n[i] - driver->last_n[i]) * ((double)sample->force_n[i] - driver->last_n[i]);
        memcpy(&bits[i], &sample->force_n[i], 4);
        driver->last_n[i] = sample->force_n[i];
    }
    uint64_t words[2] = {bits[0] << 32 | bits[1], bits[2]};
    driver->trace = hyst_hash(driver->trace, words, 2);
    step = sqrt(step);
    most_bits = hyst_load(&driver->own, HYST_TOTALS + HYST_FORCE_STEP_MAX);
    memcpy(&most, &most_bits, 8);
    memcpy(&step_bits, &step, 8);
    if (step > most) hyst_store(&driver->own, HYST_TOTALS + HYST_FORCE_STEP_MAX, step_bits);
    hyst_store(&driver->own, HYST_TOTALS + HYST_TRACE_HASH, driver->trace);
    hyst_add(&driver->own, HYST_TOTALS + HYST_INVALID_APPLIED, !(hyst_length(sample->force_n) <= driver->stated.max_force_n * 1.001f));
    if (driver->silent_ticks == 0 && command->kind == 0) {
        hyst_add(&driver->own, HYST_TOTALS + HYST_STALE_APPLIED, command->force_tick < driver->newest_force_tick);
        if (command->force_tick > driver->newest_force_tick) driver->newest_force_tick = command->force_tick;
    }
    hyst_add(&driver->own, HYST_TOTALS, 1);
    hyst_add(&driver->own, HYST_TOTALS + 1 + entry.kind, 1); /* fresh, held, ramped, zero in this order */
    memcpy(record, &entry, sizeof record);
    hyst_write_ring(driver->own.words64 + HYST_LEDGER, HYST_LEDGER_ENTRIES, entry.hardware_tick, record, sizeof record / 8);
}

/* Gives a sample to the station, its tip about the scene's pivot. force_n in it is what the motors make. */
static inline void hyst_give(hyst_driver *driver, hyst_sample *sample) {
    uint64_t record[sizeof *sample / 8];
    sample->hardware_tick = ++driver->tick;
    uint64_t now_ns = hyst_now_ns();
    if (sample->time_ns == 0) sample->time_ns = now_ns;
    hyst_sample given = *sample;
    for (int i = 0; i < 3; i++) given.pose.position_m[i] += driver->pivot_m[i];
    memcpy(record, &given, sizeof record);
    hyst_write_cell(driver->own.words64 + HYST_SAMPLE, record, sizeof record / 8);
    hyst_store(&driver->own, HYST_VALUE_NS, sample->time_ns);
    hyst_keep_ledger(driver, sample);
    hyst_store(&driver->own, HYST_HEARTBEAT_NS, now_ns);
    hyst_store(&driver->own, HYST_TICK, driver->tick);
    hyst_add(&driver->own, HYST_STEPS, 1);
    if (driver->tick == 1) hyst_set_state(driver, 3); /* live */
}

/* The pose of a scope whose four degrees of freedom about the pivot are known. */
static inline hyst_pose hyst_pose_of(float pitch_rad, float yaw_rad, float roll_rad, float insertion_m) {
    hyst_pose pose = {.pitch_rad = pitch_rad, .yaw_rad = yaw_rad, .roll_rad = roll_rad, .insertion_m = insertion_m};
    double p = pitch_rad / 2.0, y = yaw_rad / 2.0, r = roll_rad / 2.0;
    double q[4] = {cos(y) * sin(p), sin(y) * cos(p), -sin(y) * sin(p), cos(y) * cos(p)}; /* about y, then about x */
    pose.position_m[0] = (float)(insertion_m * sin(yaw_rad) * cos(pitch_rad));
    pose.position_m[1] = (float)(insertion_m * -sin(pitch_rad));
    pose.position_m[2] = (float)(insertion_m * cos(yaw_rad) * cos(pitch_rad));
    pose.orientation[0] = (float)(q[0] * cos(r) + q[1] * sin(r));
    pose.orientation[1] = (float)(q[1] * cos(r) - q[0] * sin(r));
    pose.orientation[2] = (float)(q[2] * cos(r) + q[3] * sin(r));
    pose.orientation[3] = (float)(q[3] * cos(r) - q[2] * sin(r));
    return pose;
}

/* The pose of a scope of which a device measures where the tip is, m about the pivot, and how it is turned about its axis: it goes through the pivot, and so
 * pitch, yaw and insertion follow. Nearer to the pivot than 0.1 mm the tip has no direction, and the scope lies straight. So it does with its tip in the
 * pivot when the device's is beside or behind that: the hand has drawn it out. */
static inline hyst_pose hyst_pose_at(const float position_m[3], float roll_rad) {
    double x = position_m[0], y = position_m[1], z = position_m[2], aside = sqrt(x * x + z * z), away = sqrt(aside * aside + y * y);
    if (z <= 0.0) return hyst_pose_of(0.0f, 0.0f, roll_rad, 0.0f);
    int is_away = away > 1e-4;
    return hyst_pose_of(is_away ? (float)atan2(-y, aside) : 0.0f, is_away ? (float)atan2(x, z) : 0.0f, roll_rad, (float)away);
}

static inline int hyst_is_in(float value, const float range[2]) { return value >= range[0] && value <= range[1]; }

/* A value, or the nearer end of a range; a NaN stays one, for the station to refuse. */
static inline double hyst_clamp(double value, double least, double most) { return value < least ? least : value > most ? most : value; }

/* How far aside of the axis an angle leads in 1 m along it; a quarter turn, and what is beyond, does not come back to it. */
static inline double hyst_slope(float angle_rad) { return tan(hyst_clamp(angle_rad, -1.57, 1.57)); }

/* A pose within what was stated, of one of hyst_pose_at or hyst_pose_of that may be beyond: a device goes on where the scope has its stop, and the station
 * refuses what is far out. One that is within stays as it is. Else the tip is as deep as it was, but no farther aside than the angles lead there, and not
 * behind the pivot; then roll and insertion end where they may. So it goes along with the hand, and makes no jump that the hand has not made. */
static inline hyst_pose hyst_within(const hyst_driver *driver, hyst_pose pose) {
    const float *pitch = driver->stated.pitch_rad, *yaw = driver->stated.yaw_rad, *roll = driver->stated.roll_rad, *deep = driver->stated.insertion_m;
    if (hyst_is_in(pose.pitch_rad, pitch) && hyst_is_in(pose.yaw_rad, yaw) && hyst_is_in(pose.roll_rad, roll) && hyst_is_in(pose.insertion_m, deep))
        return pose;
    double z = pose.position_m[2] < 0.0f ? 0.0 : pose.position_m[2];
    double x = hyst_clamp(pose.position_m[0], z * hyst_slope(yaw[0]), z * hyst_slope(yaw[1])), aside = sqrt(x * x + z * z);
    double y = hyst_clamp(pose.position_m[1], -aside * hyst_slope(pitch[1]), -aside * hyst_slope(pitch[0])); /* positive pitch leads to -y */
    const float tip_m[3] = {(float)x, (float)y, (float)z};
    hyst_pose near = hyst_pose_at(tip_m, (float)hyst_clamp(pose.roll_rad, roll[0], roll[1]));
    near = hyst_pose_of((float)hyst_clamp(near.pitch_rad, pitch[0], pitch[1]), (float)hyst_clamp(near.yaw_rad, yaw[0], yaw[1]), near.roll_rad,
                        (float)hyst_clamp(near.insertion_m, deep[0], deep[1]));
    near.camera_roll_rad = pose.camera_roll_rad;
    return near;
}

/* The station stops. */
static inline int hyst_end(hyst_driver *driver) {
    hyst_set_state(driver, 4);
    return 0;
}

#endif
