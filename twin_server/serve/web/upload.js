// A file on its way to the server, with how far it has come.
import { t } from "./language.js";

export function upload(path, file, progress) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("PUT", path);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.upload.onprogress = ({ loaded, total }) => progress(loaded / total);
    request.onerror = () => reject(new Error(t("error.connection_broke")));
    request.onload = () => {
      let body = {};
      try { body = JSON.parse(request.responseText); } catch { /* a proxy may answer with a page of its own */ }
      if (request.status < 300) resolve(body);
      else reject(Object.assign(new Error(body.detail || `${request.status} ${request.statusText}`), { status: request.status }));
    };
    request.send(file);
  });
}
