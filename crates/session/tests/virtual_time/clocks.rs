//! The headset's view of the server's clock.

use crate::world::*;
use netsim::LinkSettings;

/// How far the headset's idea of the server's clock is off, and how far it says it may be, in microseconds.
fn clock_error(world: &World) -> (u64, u64) {
    let clock = world.client.clock(world.headset_now()).expect("pongs have come");
    let truth = SERVER_BEGAN_US as i64 - HEADSET_BEGAN_US as i64;
    (clock.server_minus_headset_us.abs_diff(truth), clock.error_us)
}

#[test]
fn the_offset_is_exact_on_an_even_link() {
    let mut world = World::new(Setup::default());
    world.run_until(1.0);
    let (error, bound) = clock_error(&world);
    assert!(error <= 1, "{error} µs");
    assert!((2_000..2_100).contains(&bound), "{bound} µs");
}

#[test]
fn the_offset_stays_in_its_bound_under_asymmetric_jitter_and_gets_better() {
    for seed in 0..20 {
        let up = LinkSettings { delay_us: 3_000, jitter_us: 1_000, loss: 0.1, ..LinkSettings::default() };
        let down = LinkSettings { delay_us: 3_000, jitter_us: 60_000, loss: 0.1, ..LinkSettings::default() };
        let setup = Setup { seed, up, down, display_ahead_us: 120_000, ..Setup::default() };
        let mut world = World::new(setup);
        let mut errors = Vec::new();
        for tenth in 5..100 {
            world.run_until(f64::from(tenth) * 0.1);
            let (error, bound) = clock_error(&world);
            assert!(error <= bound, "seed {seed}: {error} µs at {tenth}, said to be within {bound} µs");
            errors.push(error);
        }
        // The shortest of a hundred round trips had under a tenth of the jitter, and half of that is error.
        assert!(errors[94] < 4_000, "seed {seed}: {errors:?}");
    }
}

#[test]
fn a_moment_of_the_server_is_found_on_the_headsets_clock() {
    let mut world = World::new(Setup::default());
    world.run_until(0.5);
    let moment = world.client.server_time_to_headset(world.headset_now(), world.server_now());
    let error = moment.expect("pongs have come").micros_since(world.headset_now()).abs();
    assert!(error <= 1, "{error} µs");
}
