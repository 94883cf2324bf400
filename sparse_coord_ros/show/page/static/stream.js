// Copyright 2026 The sparse_coord_ros authors. SPDX-License-Identifier: Apache-2.0
// The stream of messages from the server; it is opened again where it breaks.

export const token = location.hash.slice(1);

export function connect(query, take, lost) {
  let socket = null, retry = 500;
  const open = () => {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws${query}`);
    socket.onopen = () => { retry = 500; };
    socket.onmessage = (event) => take(JSON.parse(event.data));
    socket.onclose = () => {
      lost();
      setTimeout(open, retry);
      retry = Math.min(5000, retry * 1.5);
    };
  };
  open();
  return {
    // Returns whether there is a connection.
    send(what, value) {
      const connected = socket.readyState === WebSocket.OPEN;
      if (connected) socket.send(JSON.stringify({ do: what, value, token }));
      return connected;
    },
  };
}
