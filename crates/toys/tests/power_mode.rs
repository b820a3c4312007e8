//! The range of AFC33 is that of power mode.

use mishandle_rollout::{Request, Seed, Specification};
use mishandle_stl::Formula;

#[test]
fn every_pedal_of_afc33_reaches_power_mode_before_the_requirement_begins() {
    let target = mishandle_toys::arch::target("arch/afc33").expect("a problem").expect("a target");
    let requirement = Formula::parse(&target.formulas[0].text).expect("a formula");
    let space = target.space("instance-2").expect("a space");
    let mut system = target.system(&space, &Specification::new(requirement)).expect("a system");
    let corners = (0..64).map(|corner| {
        let bits = (0..space.dimension()).map(|axis| f64::from(u8::from(corner >> (axis % 6) & 1 == 1)));
        Request::new(space.at(&bits.collect::<Vec<f64>>()), Seed(0))
    });
    for episode in system.rollout(&corners.collect::<Vec<_>>()).expect("episodes") {
        let open_loop = episode.trace.signal("open_loop").expect("a signal");
        // Samples of 10 ms: startup ends at 10 s, and feedback would begin then.
        assert!(open_loop[1100..].iter().all(|mode| *mode == 1.0), "{:?}", episode.request.scenario);
        assert!(!episode.is_violated());
    }
}
