// A file on its way to the server, with how far it has come.

export function upload(path, file, progress) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("PUT", path);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.upload.onprogress = ({ loaded, total }) => progress(loaded / total);
    request.onerror = () => reject(new Error("The connection broke. Try again."));
    request.onload = () => {
      let body = {};
      try { body = JSON.parse(request.responseText); } catch { /* a proxy may answer with a page of its own */ }
      if (request.status < 300) resolve(body);
      else reject(new Error(body.detail || `${request.status} ${request.statusText}`));
    };
    request.send(file);
  });
}
