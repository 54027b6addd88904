//! Where the operator's page is: port and token, in one file in the station's root, which its user alone may read. The console writes it, and its
//! successor goes on with it, so that a browser finds the page again; the guardian and `hystation status` show it.
//!
//! Promise: a reader finds a whole address or none, whoever dies when; what is no address is none.

use hyst_exchange::{Station, whole};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Letters of a token: 128 bits, hexadecimal.
pub const TOKEN_LETTERS: usize = 32;

/// Port and token.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Address {
    /// Port on 127.0.0.1.
    pub port: u16,
    /// What a browser has to show.
    pub token: String,
}

fn path(station: &Station) -> PathBuf {
    station.root().join("console.json")
}

impl Address {
    /// The address of the station's page, if it has one.
    pub fn read(station: &Station) -> Option<Address> {
        let address: Address = serde_json::from_str(&std::fs::read_to_string(path(station)).ok()?).ok()?;
        let is_token = address.token.len() == TOKEN_LETTERS && address.token.bytes().all(|byte| byte.is_ascii_hexdigit());
        (is_token && address.port != 0).then_some(address)
    }

    /// Keeps the address.
    pub fn write(&self, station: &Station) -> std::io::Result<()> {
        whole::write_for_own_user(&path(station), serde_json::to_string(self)?.as_bytes())
    }

    /// What is opened in a browser.
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/?token={}", self.port, self.token)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn an_address_is_read_back_by_its_user_alone_and_nonsense_is_none() {
        let station = Station::named(&format!("t{}-address", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        assert_eq!(Address::read(&station), None);
        let address = Address { port: 8_642, token: "0123456789abcdef".repeat(2) };
        address.write(&station).unwrap();
        assert_eq!(Address::read(&station).as_ref(), Some(&address));
        assert_eq!(std::fs::metadata(path(&station)).unwrap().permissions().mode() & 0o777, 0o600);
        assert_eq!(address.url(), "http://127.0.0.1:8642/?token=0123456789abcdef0123456789abcdef");
        let others = [
            Address { port: 0, ..address.clone() },
            Address { token: "0123".into(), ..address.clone() },
            Address { token: "../".repeat(10) + "ab", ..address.clone() },
        ];
        for other in others {
            other.write(&station).unwrap();
            assert_eq!(Address::read(&station), None, "{other:?}");
        }
        std::fs::write(path(&station), "{\"port\":1").unwrap();
        assert_eq!(Address::read(&station), None);
        station.wipe();
    }
}
