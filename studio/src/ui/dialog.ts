/** A sheet over the page: Escape and a click beside it close it. */
import { el, freshId } from "../dom";
import { button } from "./controls";

export class Dialog {
  readonly element: HTMLDialogElement;

  constructor(title: string, ...children: (HTMLElement | null)[]) {
    const id = freshId("dialog");
    const close = button({ label: "Close", icon: "close", iconOnly: true, look: "quiet", onClick: () => this.element.close() });
    const head = el("header", {}, el("h2", { id }, title), close);
    this.element = el("dialog", { "aria-labelledby": id }, head, el("div", { class: "dialog-body" }, ...children));
    this.element.addEventListener("click", (event) => {
      if (event.target === this.element) this.element.close();
    });
    document.body.append(this.element);
  }

  open(): void {
    if (!this.element.open) this.element.showModal();
  }

  close(): void {
    this.element.close();
  }
}
