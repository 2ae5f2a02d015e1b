//! Sends samples to plotters over UDP while they come, with the board's own time stamps. `PlotJuggler` takes JSON
//! objects ("UDP Server", message protocol JSON, `timestamp` as embedded time). Teleplot takes lines of
//! `name:milliseconds:value§unit`.

use motorbench_core::message::Sample;
use motorbench_core::settings::{Param, Settings};
use motorbench_data::recording::{Channel, Recording};
use motorbench_data::telemetry;
use std::fmt::Write as _;
use std::net::{SocketAddr, UdpSocket};

/// Default address of `PlotJuggler`.
pub const PLOTJUGGLER: &str = "127.0.0.1:9870";
/// Default address of Teleplot.
pub const TELEPLOT: &str = "127.0.0.1:47269";

/// Sends samples. A plotter that is not running yet misses them; nothing waits for it.
#[derive(Debug)]
pub struct Live {
    socket: UdpSocket,
    plotjuggler: Option<SocketAddr>,
    teleplot: Option<SocketAddr>,
}

impl Live {
    /// Sends to the given plotters.
    ///
    /// # Errors
    /// The message of the operating system if it has no UDP socket.
    pub fn new(plotjuggler: Option<SocketAddr>, teleplot: Option<SocketAddr>) -> std::io::Result<Self> {
        let either = plotjuggler.or(teleplot);
        let any = if either.is_some_and(|address| address.is_ipv6()) { "[::]:0" } else { "0.0.0.0:0" };
        Ok(Self { socket: UdpSocket::bind(any)?, plotjuggler, teleplot })
    }

    /// Sends one sample of a recording; missing values are left out.
    ///
    /// # Errors
    /// Errors of sending; a missing listener is no error.
    pub fn send(&self, recording: &Recording, index: usize) -> std::io::Result<()> {
        let t_s = recording.time_s().map_or(f64::NAN, |time_s| time_s[index]);
        self.send_at(t_s, recording, index)
    }

    /// Sends the telemetry's samples, with the tick of the board as time.
    ///
    /// # Errors
    /// As [`send`](Self::send).
    pub fn send_samples(&self, samples: &[Sample], settings: &Settings) -> std::io::Result<()> {
        let recording = telemetry::recording("live", samples, settings);
        let rate_hz = f64::from(settings.get(Param::TickRate));
        for (index, sample) in samples.iter().enumerate() {
            self.send_at(f64::from(sample.tick) / rate_hz, &recording, index)?;
        }
        Ok(())
    }

    fn send_at(&self, t_s: f64, recording: &Recording, index: usize) -> std::io::Result<()> {
        let values: Vec<(&str, f64)> = recording
            .channels()
            .filter(|channel| *channel != Channel::Time)
            .filter_map(|channel| Some((channel.column(), recording.get(channel)?[index])))
            .filter(|(_, value)| value.is_finite())
            .collect();
        if let Some(address) = self.plotjuggler {
            self.socket.send_to(plotjuggler(t_s, &values).as_bytes(), address)?;
        }
        if let Some(address) = self.teleplot {
            self.socket.send_to(teleplot(t_s, &values).as_bytes(), address)?;
        }
        Ok(())
    }
}

fn plotjuggler(t_s: f64, values: &[(&str, f64)]) -> String {
    let mut object = serde_json::Map::from_iter([("timestamp".to_string(), t_s.into())]);
    object.extend(values.iter().map(|(name, value)| ((*name).to_string(), (*value).into())));
    serde_json::Value::Object(object).to_string()
}

fn teleplot(t_s: f64, values: &[(&str, f64)]) -> String {
    values.iter().fold(String::new(), |mut lines, (name, value)| {
        // Whole microseconds: Teleplot takes fractions of a millisecond.
        let _ = writeln!(lines, "{name}:{}:{value}{}", (t_s * 1e6).round() / 1e3, unit(name));
        lines
    })
}

/// Unit after the last word of a column's name, in Teleplot's form.
fn unit(column: &str) -> String {
    let unit = column.split_once('_').map_or("", |(_, unit)| unit).replace("_per_", "/");
    if unit.is_empty() { unit } else { format!("§{unit}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_core::message::State;

    #[test]
    fn samples_carry_the_boards_time_and_names_without_spaces() {
        let plotter = UdpSocket::bind("127.0.0.1:0").unwrap();
        plotter.set_read_timeout(Some(std::time::Duration::from_secs(5))).unwrap();
        let address = plotter.local_addr().unwrap();
        let settings = Settings::defaults();
        let sample = |tick| Sample { tick, counts: 7, state: State::default(), ..Sample::default() };
        Live::new(Some(address), Some(address))
            .unwrap()
            .send_samples(&[sample(1500), sample(1502)], &settings)
            .unwrap();
        let mut buffer = [0; 2048];
        let mut received = || {
            let length = plotter.recv(&mut buffer).unwrap();
            String::from_utf8(buffer[..length].to_vec()).unwrap()
        };
        let rate_hz = f64::from(settings.get(Param::TickRate));
        for tick in [1500.0, 1502.0] {
            let object: serde_json::Value = serde_json::from_str(&received()).unwrap();
            assert!((object["timestamp"].as_f64().unwrap() - tick / rate_hz).abs() < 1e-9);
            assert_eq!(object["counts"], 7.0);
            assert!(object.get("u_V").is_none(), "the bridge is off: there is no voltage");
            let lines = received();
            let speed = format!("omega_rad_per_s:{}:0§rad/s\n", 1e3 * tick / rate_hz);
            assert!(
                lines.contains(&speed) && lines.contains(&format!("counts:{}:7\n", 1e3 * tick / rate_hz)),
                "{lines}"
            );
        }
    }
}
