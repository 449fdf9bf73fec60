use super::*;

#[test]
fn sizes() {
    assert_eq!(size("1280x720"), Ok([1280, 720]));
    assert_eq!(size("1X1"), Ok([1, 1]));
    for bad in ["", "x", "0x5", "5x0", "5", "-5x5", "5x5x5", "99999999999x1", "1.5x2", "5 x 5", "NaNxNaN"] {
        assert!(size(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn colors() {
    assert_eq!(color("102030"), Ok([0x10, 0x20, 0x30, 0xff]));
    assert_eq!(color("#FFffFF00"), Ok([255, 255, 255, 0]));
    for bad in ["", "#", "12345", "1234567", "gggggg", "+12345", "été", "123456789"] {
        assert!(color(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn orbits() {
    assert_eq!(orbit("-30,20.5,2"), Ok(Orbit { azimuth: -30.0, elevation: 20.5, distance: 2.0 }));
    assert!(orbit("0,90,0").is_ok());
    for bad in ["", "1,2", "1,2,3,4", "0,91,2", "0,0,-1", "nan,0,1", "0,0,inf", "a,b,c"] {
        assert!(orbit(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn vectors_and_ups() {
    assert_eq!(vector("1,-2,3e2"), Ok(DVec3::new(1.0, -2.0, 300.0)));
    assert!(vector("1,2").is_err() && vector("1,2,inf").is_err() && vector("").is_err());
    assert_eq!(up("z"), Ok(DVec3::Z));
    assert_eq!(up("-y"), Ok(DVec3::NEG_Y));
    assert_eq!(up("0,0,1e300"), Ok(DVec3::Z));
    assert_eq!(up("-1e-300,0,0"), Ok(DVec3::NEG_X));
    assert!(up("0,0,0").is_err() && up("w").is_err() && up("").is_err() && up("-").is_err() && up("é").is_err());
}

#[test]
fn radii() {
    assert_eq!(radius("auto"), Ok(Radius::Auto));
    assert_eq!(radius("0.5"), Ok(Radius::Value(0.5)));
    assert_eq!(radius("scale:2"), Ok(Radius::Scale(2.0)));
    assert_eq!(radius("angle:180"), Err("an angular step is less than 90 degrees".into()));
    assert_eq!(radius("angle:0.1"), Ok(Radius::Angular(Some(0.1f32.to_radians()))));
    assert_eq!(radius("angle:auto"), Ok(Radius::Angular(None)));
    assert_eq!(radius("px:3"), Ok(Radius::Pixels(3.0)));
    for bad in ["", "0", "-1", "nan", "inf", "1e-60", "scale:", "scale:0", "px:0", "px:5000", "px:x"] {
        assert!(radius(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn angles() {
    assert_eq!(fov("60"), Ok(60.0));
    for bad in ["0", "180", "-1", "nan", ""] {
        assert!(fov(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn inputs() {
    let scene = |name: &str, points, seed| Ok(Input::Scene { name: name.into(), points, seed });
    assert_eq!(input("a:b.ply".into()), Ok(Input::File("a:b.ply".into())));
    assert_eq!(input("scene:demo".into()), scene("demo", DEMO_POINTS, 1));
    assert_eq!(input("scene:torus:20k".into()), scene("torus", 20_000, 1));
    assert_eq!(input("scene:noise:5:9".into()), scene("noise", 5, 9));
    for bad in ["scene:", "scene:x", "scene:demo:0", "scene:demo:1:2:3", "scene:demo:x", "scene:demo:9999999999M"] {
        assert!(input(bad.into()).is_err(), "{bad:?}");
    }
}
