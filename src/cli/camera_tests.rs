use glam::dvec3;

use super::*;

fn bounds(center: DVec3, half: DVec3) -> Bounds {
    let (min, max) = (center - half, center + half);
    Bounds { min, max, robust_min: min, robust_max: max, center, radius: half.length() }
}

fn lens(up: DVec3, aspect: f64) -> Lens {
    Lens { up, up_given: false, fov: None, aspect }
}

fn eye(pose: Pose, subject: &Subject, lens: &Lens) -> DVec3 {
    view(pose, subject, lens).0.eye().truncate()
}

fn orbit(azimuth: f64, elevation: f64, distance: f64) -> Pose {
    Pose::Orbit(Orbit { azimuth, elevation, distance })
}

/// Direction of the middle of the picture.
fn look(view: &View) -> DVec3 {
    view.view.inverse().transform_vector3(DVec3::NEG_Z)
}

#[test]
fn azimuth_zero_looks_as_the_manual_says() {
    let subject = Subject { bounds: bounds(dvec3(5.0, 6.0, 7.0), DVec3::ONE), balls: &[], viewpoint: None };
    let cases =
        [(DVec3::Y, DVec3::NEG_Z), (DVec3::Z, DVec3::Y), (DVec3::NEG_Y, DVec3::Z), (DVec3::NEG_Z, DVec3::NEG_Y)];
    for (up, direction) in cases {
        let (v, _) = view(orbit(0.0, 0.0, 2.0), &subject, &lens(up, 1.0));
        assert!((look(&v) - direction).length() < 1e-12, "{up} {}", look(&v));
        let r = 3f64.sqrt();
        assert!((v.eye().truncate() - (subject.bounds.center - direction * 2.0 * r)).length() < 1e-9);
    }
    // A quarter turn to the left of both: from +X.
    for up in [DVec3::Y, DVec3::Z] {
        let (v, _) = view(orbit(90.0, 0.0, 1.0), &subject, &lens(up, 1.0));
        assert!((look(&v) - DVec3::NEG_X).length() < 1e-12);
    }
}

#[test]
fn elevation_lifts_and_poles_are_no_trouble() {
    let subject = Subject { bounds: bounds(DVec3::ZERO, DVec3::ONE), balls: &[], viewpoint: None };
    for up in [DVec3::X, DVec3::Y, DVec3::Z, dvec3(1.0, 1.0, 1.0).normalize(), dvec3(-3.0, 0.1, 2.0).normalize()] {
        let l = lens(up, 1.5);
        for elevation in [-90.0, -30.0, 0.0, 60.0, 90.0f64] {
            let e = eye(orbit(77.0, elevation, 3.0), &subject, &l) / (3.0 * 3f64.sqrt());
            assert!((e.dot(up) - elevation.to_radians().sin()).abs() < 1e-9, "{up} {elevation} {e}");
            assert!((e.length() - 1.0).abs() < 1e-9);
        }
        // From the centre itself: nothing is divided by the distance.
        let (v, _) = view(orbit(10.0, 0.0, 0.0), &subject, &l);
        assert!(v.view.is_finite() && v.eye().truncate().length() < 1e-9);
    }
}

#[test]
fn the_default_view_frames_everything_tightly() {
    // A sphere's worth of balls far from the origin, in wide, square and tall pictures.
    let center = dvec3(5e5, 4.9e6, -3.0);
    let on_sphere = |i: usize| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / 2000.0;
        let a = i as f64 * 2.399963229728653;
        let s = (1.0 - z * z).sqrt();
        (center + 7.0 * dvec3(s * a.cos(), s * a.sin(), z), 0.2)
    };
    let balls: Vec<Ball> = (0..2000).map(on_sphere).collect();
    let subject = Subject { bounds: bounds(center, DVec3::splat(7.0)), balls: &balls, viewpoint: None };
    for aspect in [16.0 / 9.0, 1.0, 0.3] {
        let (v, _) = view(Pose::Default, &subject, &lens(DVec3::Z, aspect));
        let clip = v.projection * v.view;
        let mut largest = [0.0f64; 2];
        for (p, _) in &balls {
            let q = clip * p.extend(1.0);
            assert!(q.w > 0.0);
            largest = [largest[0].max((q.x / q.w).abs()), largest[1].max((q.y / q.w).abs())];
        }
        let tightest = largest[0].max(largest[1]);
        assert!(tightest < 1.0 - 2.0 * MARGIN && tightest > 0.85, "{aspect}: {largest:?}");
    }
}

#[test]
fn single_points_and_nothing_have_a_view() {
    let p = dvec3(1.0, 2.0, 3.0);
    for balls in [vec![(p, 1.0)], vec![(p, 0.0)], vec![]] {
        let subject = Subject { bounds: bounds(p, DVec3::ZERO), balls: &balls, viewpoint: None };
        let (v, _) = view(Pose::Default, &subject, &lens(DVec3::Y, 1.0));
        assert!(v.view.is_finite() && v.near() > 0.0);
        assert!((v.eye().truncate() - p).length() > v.near(), "{balls:?}");
    }
}

#[test]
fn near_planes_are_before_what_is_near() {
    let balls = [(DVec3::ZERO, 0.01)];
    let subject = Subject { bounds: bounds(DVec3::ZERO, DVec3::ONE), balls: &balls, viewpoint: None };
    assert!(near(&subject, DVec3::ZERO) <= 0.005);
    assert!(near(&subject, dvec3(1e9, 0.0, 0.0)) < 1e9);
}

#[test]
fn impossible_views_are_refused_and_guesses_give_way() {
    let at = |x: f64, y: f64, z: f64| dvec3(x, y, z);
    let look_at = |eye, target| Pose::LookAt { eye, target };
    assert!(check(look_at(at(1.0, 2.0, 3.0), at(1.0, 2.0, 3.0)), None).is_err());
    assert!(check(look_at(DVec3::ZERO, DVec3::ZERO), None).is_err());
    assert!(check(look_at(at(1e200, 0.0, 0.0), DVec3::ZERO), None).is_err());
    let down = look_at(at(0.0, 0.0, 5.0), DVec3::ZERO);
    assert!(check(down, Some(DVec3::Z)).is_err());
    assert!(check(down, Some(DVec3::Y)).is_ok());
    assert!(check(down, None).is_ok());
    let subject = Subject { bounds: bounds(DVec3::ZERO, DVec3::ONE), balls: &[], viewpoint: None };
    let (v, said) = view(down, &subject, &lens(DVec3::Z, 1.0));
    assert!(v.view.is_finite() && said.len() == 1);
    // North is up on a map.
    assert!((v.view.inverse().transform_vector3(DVec3::Y) - DVec3::Y).length() < 1e-9);
}

#[test]
fn a_scanner_inside_is_where_the_view_starts() {
    let b = bounds(DVec3::ZERO, DVec3::splat(3.0));
    let inside = Subject { bounds: b, balls: &[], viewpoint: Some(DVec3::ONE) };
    assert!((eye(Pose::Default, &inside, &lens(DVec3::Z, 1.0)) - DVec3::ONE).length() < 1e-9);
    let outside = Subject { viewpoint: Some(DVec3::splat(30.0)), ..inside };
    assert!(eye(Pose::Default, &outside, &lens(DVec3::Z, 1.0)).length() > 3.0);
}

#[test]
fn inside_the_view_goes_where_it_is_deep() {
    // A long corridor along x, the scanner at its left end.
    let walls = |i: usize| (dvec3(i as f64 * 0.02, if i.is_multiple_of(2) { 1.0 } else { -1.0 }, 0.0), 0.01);
    let balls: Vec<Ball> = (0..1000).map(walls).collect();
    // Looking along +X is azimuth 270 where z is up.
    assert_eq!(deepest(&balls, dvec3(1.0, 0.0, 0.0), DVec3::Z), 270.0);
    assert_eq!(deepest(&[], DVec3::ZERO, DVec3::Z), 0.0);
}

#[test]
fn named_views_mean_the_same_for_every_scan() {
    let (center, half) = (dvec3(5e5, -7.0, 40.0), dvec3(6.0, 2.0, 5.0));
    let subject = Subject { bounds: bounds(center, half), balls: &[], viewpoint: Some(center) };
    for (up, aspect, fov) in [(DVec3::Y, 1.0, None), (DVec3::Z, 2.0, Some(1.2)), (DVec3::X, 0.5, Some(0.3))] {
        let lens = Lens { fov, ..lens(up, aspect) };
        let of = |named| view(Pose::Named(named), &subject, &lens).0;
        // Of a picture of 640 px on its smaller side; the outline of a sphere in the middle is a circle.
        let v = of(Named::Distance);
        let height = 640.0 / aspect.min(1.0);
        let distance = (v.eye().truncate() - center).length();
        let tan = half.length() / (distance * distance - half.length_squared()).sqrt();
        assert!((2.0 * v.focal(height) * tan - 320.0).abs() < 1e-3, "{up}");
        assert!((look(&v) - (center - v.eye().truncate()) / distance).length() < 1e-9);
        let (centre, border) = (of(Named::Centre), of(Named::Border));
        assert!((centre.eye().truncate() - center).length() < 1e-9);
        // On one face and within the others, looking level through the centre.
        let off = (border.eye().truncate() - center) / half;
        assert!((off.abs().max_element() - 1.0).abs() < 1e-9, "{off}");
        assert!((look(&border) + (off * half).normalize()).length() < 1e-9);
        assert!(look(&border).dot(up).abs() < 1e-12 && (look(&border) - look(&centre)).length() < 1e-12);
        // Seen from above all look the same way.
        let level = look(&v) - up * look(&v).dot(up);
        assert!((level.normalize() - look(&centre)).length() < 1e-9);
    }
    // Nothing is divided by a box without height, or without anything.
    for half in [dvec3(1.0, 0.0, 2.0), DVec3::ZERO] {
        let subject = Subject { bounds: bounds(center, half), balls: &[], viewpoint: None };
        for named in [Named::Distance, Named::Border, Named::Centre] {
            let (v, _) = view(Pose::Named(named), &subject, &lens(DVec3::Y, 1.0));
            assert!(v.view.is_finite() && v.near() > 0.0, "{named:?} {half}");
        }
        let on = eye(Pose::Named(Named::Border), &subject, &lens(DVec3::Y, 1.0)) - center;
        assert!((on.length() == 0.0) == (half.x == 0.0), "{on}");
    }
}
