/* The example of a driver: a device that is not there. Its tip is a mass on the spring of a hand that presses it against the back wall of the cavity and
 * draws it back, once in three seconds; the motors push it as the station says. It measures and pushes along three axes of its own, as DHD's devices do. A
 * driver of a real device has the device's own library in the place of `motors` and `encoders`, and its own way in `to_world` and `to_device`.
 *
 *     cc -std=c11 -O2 -Wall -Wextra -pthread -I assets/driver assets/driver/example_driver.c -o example_driver -lm
 *     hystation conformance driver ./example_driver
 *     hystation run --driver ./example_driver
 *
 * -DCALLBACK=1 makes one whose loop runs in a thread beside `main`, as with a library that has a servo loop of its own and calls the driver back.
 * -DRATE_HZ=2000 makes one of twice as many samples: the motors still hear the station a thousand times a second.
 * -DPLUG='"FILE"' makes one whose device is plugged in for as long as there is that file.
 * -DHELD='"FILE"' makes one whose hand goes in once and stays there; while there is that file it is there from the first tick on, as a hand is that holds on
 * while its driver is started again.
 * -DFLAW=1 to 17 makes one that does wrong, to see that it is found.
 */
#define _GNU_SOURCE
#include "hystation_driver.h"

#ifndef CALLBACK
#define CALLBACK 0
#endif
#ifndef PLUG
#define PLUG "/"
#endif
#ifndef HELD
#define HELD ""
#endif

#ifndef RATE_HZ
#define RATE_HZ 1000
#endif
#ifndef FLAW
#define FLAW 0
#endif
#ifndef FORCE_N
#define FORCE_N 2.0f /* what its motors can make */
#endif
#ifndef DAMPING_N_S_M
#define DAMPING_N_S_M 13.4f /* that it states of the hand that holds it */
#endif
#ifndef YAW_RAD
#define YAW_RAD 0.6f /* how far it states that it turns to each side */
#endif
enum {
    STATES_NO_NUMBER = 1, SPEAKS_DEGREES, IS_SLOW, STAMPS_OLD, MAKES_NOTHING, MAKES_TWICE, NEVER_LETS_GO, KNOWS_ONE_DEVICE, GOES_ON, SAYS_NAN, JUMPS,
    STATES_NOTHING, FOCUSES_IN_MM, PUSHES_BACK, SWAPS_AXES, SPEAKS_MM_S, FOLLOWS_OLD
};

static const float INSERTION_M = 0.045f; /* the tip in the middle of the cavity, where the device's own origin is */
static const float PERIOD_S = 1.0f / RATE_HZ;
static const uint64_t PERIOD_NS = 1000000000u / RATE_HZ;

/* The hand and the tip that it holds, in the device's own axes: x towards whoever sits before it, y to their right, z up. */
typedef struct {
    float position_m[3], velocity_m_s[3];
    uint64_t ticks;
} device;

/* Whoever sits before the device looks into the patient, who lies on the back: away from them is inwards, up is anterior. That is a turn, and no mirror
 * image; forces go back by the same one. */
static void to_world(const float own[3], float world[3]) { world[0] = -own[1], world[1] = own[2], world[2] = -own[0]; }
static void to_device(const float world[3], float own[3]) { own[0] = -world[2], own[1] = -world[0], own[2] = world[1]; }

static const float DEEPEST_S = 1.5f; /* after the rest */

static float wanted_m(uint64_t ticks) {
    float time_s = (float)ticks * PERIOD_S - 1.0f; /* at rest in the first second */
    if (sizeof HELD > 1 && time_s > DEEPEST_S) time_s = DEEPEST_S;
    return time_s < 0.0f ? 0.0f : -0.006f * (1.0f - cosf(2.0f * 3.14159265f * time_s / 3.0f));
}

/* A hand of 300 N/m that holds 150 g, with as much damping as a grip has; it wants up and down. */
static void motors(device *it, const float force_n[3]) {
    const float stiffness_n_m = 300.0f, mass_kg = 0.15f, damping_n_s_m = 13.4f, hold_m[3] = {0.0f, 0.0f, wanted_m(it->ticks)};
    float own_n[3];
    to_device(force_n, own_n);
    for (int i = 0; i < 3; i++) {
        float push_n = stiffness_n_m * (hold_m[i] - it->position_m[i]) - damping_n_s_m * it->velocity_m_s[i] + own_n[i];
        it->velocity_m_s[i] += push_n / mass_kg * PERIOD_S;
        it->position_m[i] += it->velocity_m_s[i] * PERIOD_S;
    }
    it->ticks++;
}

static hyst_sample encoders(const hyst_driver *driver, const device *it, const float force_n[3]) {
    hyst_sample sample = {
        .force_n = {force_n[0], force_n[1], force_n[2]},
        .controls = {.inflow_valve = 1.0f, .outflow_valve = 0.3f, .set_pressure_pa = 9333.0f, .light = 1.0f, .focus_m = 0.020f},
    };
    float tip_m[3];
    to_world(it->position_m, tip_m);
    tip_m[2] += INSERTION_M;
    sample.pose = hyst_within(driver, hyst_pose_at(tip_m, 0.0f)); /* it measures no turn about the scope's axis, and has no stop where that has one */
    to_world(it->velocity_m_s, sample.velocity_m_s);
    return sample;
}

/* What FLAW makes of a sample and of a force. */
static void spoil(const hyst_driver *driver, hyst_sample *sample, float force_n[3]) {
    static uint32_t first_device;
    static float kept_n[3];
    if (first_device == 0) first_device = driver->device_incarnation;
    int is_mute = FLAW == MAKES_NOTHING || (FLAW == KNOWS_ONE_DEVICE && driver->device_incarnation != first_device);
    if (FLAW == FOLLOWS_OLD && driver->device_incarnation != first_device && driver->command.device_incarnation == first_device) {
        hyst_command found; /* in the page of the next one, before that has said anything of its own */
        uint64_t record[sizeof found / 8];
        if (hyst_read_cell(driver->device.words64 + HYST_COMMAND, record, sizeof record / 8) != 0) {
            memcpy(&found, record, sizeof found);
            memcpy(force_n, found.force_n, sizeof found.force_n);
        }
    }
    for (int i = 0; i < 3; i++) {
        if (FLAW == NEVER_LETS_GO && driver->silent_ticks == 0) kept_n[i] = force_n[i];
        float made_n = FLAW == NEVER_LETS_GO ? kept_n[i] : force_n[i];
        force_n[i] = sample->force_n[i] = is_mute ? 0.0f : FLAW == MAKES_TWICE ? 2.0f * made_n : made_n;
        if (FLAW == PUSHES_BACK) force_n[i] = -force_n[i]; /* and its ledger has what it was told */
        if (FLAW == SPEAKS_MM_S) sample->velocity_m_s[i] *= 1000.0f;
    }
    if (FLAW == SWAPS_AXES) {
        const float *at_m = sample->pose.position_m, *goes_m_s = sample->velocity_m_s;
        const float swapped_m[3] = {at_m[1], at_m[0], at_m[2]}, swapped_m_s[3] = {goes_m_s[1], goes_m_s[0], goes_m_s[2]};
        sample->pose = hyst_pose_at(swapped_m, 0.0f);
        memcpy(sample->velocity_m_s, swapped_m_s, sizeof swapped_m_s);
    }
    if (FLAW == SPEAKS_DEGREES) sample->pose.pitch_rad *= 57.3f, sample->pose.roll_rad = 90.0f;
    if (FLAW == STAMPS_OLD) sample->time_ns = 1 + hyst_now_ns() / 1000000000u * 1000000000u; /* once a second */
    if (FLAW == SAYS_NAN && driver->tick % 50 == 7) sample->pose.position_m[1] = NAN;
    if (FLAW == FOCUSES_IN_MM) sample->controls.focus_m = 20.0f;
    if (FLAW == JUMPS && driver->tick % 100 == 7) sample->pose = hyst_pose_of(0.5f, 0.5f, 0.0f, 0.08f);
}

/* One turn of the loop: the force to the motors, the encoders to the station. */
static void turn(hyst_driver *driver, device *it) {
    float force_n[3];
    hyst_take(driver, force_n);
    hyst_sample sample = encoders(driver, it, force_n);
    hyst_from_window(driver, &sample, HYST_WINDOW_CONTROLS); /* it has a tip, and nothing else */
    spoil(driver, &sample, force_n);
    motors(it, force_n);
    hyst_give(driver, &sample);
}

/* Whether the device is there: what a library says when it is opened, and by its errors later. */
static int is_plugged_in(void) { return access(PLUG, F_OK) == 0; }

/* It was there: with 1 the driver is started again, and looks for it. */
static int pulled_out(hyst_driver *driver) { return hyst_fail(driver, 1, "the device is gone: plug it in again"); }

static void be_real_time(hyst_driver *driver) {
    if (!hyst_real_time(driver)) fprintf(stderr, "not real time: `hystation doctor` says how to allow it\n");
}

/* What a library's servo loop has to know: whose it is, and when to end. */
typedef struct {
    hyst_driver *driver;
    device it;
    atomic_int is_stopped;
} servo;

/* Stands for the thread of such a library. The clock is its own: a callback does not wait. */
static void *servo_loop(void *data) {
    servo *own = data;
    be_real_time(own->driver); /* in this thread, for it is about the one that calls it */
    while (!atomic_load(&own->is_stopped)) {
        hyst_wait(own->driver, PERIOD_NS);
        turn(own->driver, &own->it);
    }
    return NULL;
}

/* What `main` does beside such a loop: it asks whether station and device go on, stops the loop, and only then says that it ends. */
static int beside(servo *own) {
    pthread_t thread;
    const struct timespec pause = {.tv_nsec = 20000000};
    if (pthread_create(&thread, NULL, servo_loop, own) != 0) return hyst_fail(own->driver, 1, "there is no thread for the servo loop");
    while (hyst_goes_on(own->driver) && is_plugged_in()) nanosleep(&pause, NULL);
    int is_over = !hyst_goes_on(own->driver);
    atomic_store(&own->is_stopped, 1);
    pthread_join(thread, NULL);
    return is_over ? hyst_end(own->driver) : pulled_out(own->driver);
}

int main(int argc, char **argv) {
    static hyst_driver driver;
    int code = hyst_begin(&driver, argc, argv);
    if (code >= 0) return code;
    if (!is_plugged_in()) return hyst_fail(&driver, 2, "the device is not plugged in: plug it in, and start the station again");
    hyst_statement statement = {
        .version = HYST_STATEMENT_VERSION,
        .measured_dof = 3,
        .driven_dof = 3,
        .rate_hz = RATE_HZ,
        .max_force_n = FLAW == STATES_NO_NUMBER ? NAN : FORCE_N,
        .max_stiffness_n_m = 800.0f,
        .max_damping_n_s_m = 1.0f,
        .continuous_force_n = 0.3f,
        .device_damping_n_s_m = DAMPING_N_S_M,
        .pitch_rad = {-0.6f, 0.6f}, .yaw_rad = {-YAW_RAD, YAW_RAD}, .roll_rad = {-3.1f, 3.1f}, .insertion_m = {0.0f, 0.1f},
        .maker = "hystation",
        .name = "example in C",
    };
    if (FLAW != STATES_NOTHING) hyst_state(&driver, &statement);
    static servo own;
    own.driver = &driver;
    if (access(HELD, F_OK) == 0) own.it.ticks = 5 * RATE_HZ / 2, own.it.position_m[2] = wanted_m(own.it.ticks);
    if (CALLBACK) return beside(&own);
    be_real_time(&driver);
    while (hyst_goes_on(&driver) || FLAW == GOES_ON) {
        if (!is_plugged_in()) return pulled_out(&driver);
        hyst_wait(&driver, FLAW == IS_SLOW ? 2 * PERIOD_NS : PERIOD_NS);
        turn(&driver, &own.it);
    }
    return hyst_end(&driver);
}
