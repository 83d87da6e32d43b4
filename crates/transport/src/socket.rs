//! UDP sockets with room for a burst.

use socket2::{Domain, Protocol, Socket, Type};
use std::io;
use std::net::{SocketAddr, UdpSocket};

/// A bound socket. Buffers that the system does not grant are as large as it allows.
pub(crate) fn bind(address: SocketAddr, buffer_bytes: usize) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::for_address(address), Type::DGRAM, Some(Protocol::UDP))?;
    if address.is_ipv6() {
        // `[::]` listens for IPv4 too. Where the system cannot, IPv6 alone still works.
        let _ = socket.set_only_v6(false);
    }
    for (name, result) in [
        ("receive", socket.set_recv_buffer_size(buffer_bytes)),
        ("send", socket.set_send_buffer_size(buffer_bytes)),
    ] {
        if let Err(error) = result {
            tracing::debug!(%error, name, buffer_bytes, "socket buffer stays as it is");
        }
    }
    socket.bind(&address.into())?;
    Ok(socket.into())
}
